"""A signal ends a process at once, in one line, wherever it is."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

START = """
import os, sys, time
from qparm.stopping import at_stop, end_on_signals
end_on_signals()
def ready():
    print("ready", flush=True)
"""
# Where no exception would get out, or the main thread does not get to handle a signal.
PLACES = {
    "python": "ready()\nwhile True: pass",
    "sleep": "ready()\ntime.sleep(60)",
    "finally": (
        "try:\n    1 / 0\nexcept ArithmeticError:\n    try: ready(); time.sleep(60)\n    finally: time.sleep(60)"
    ),
    "destructor": "class A:\n    def __del__(self): ready(); time.sleep(60)\nA()",
    "import": (
        "import importlib.abc, importlib.machinery\n"
        "class Slow(importlib.abc.MetaPathFinder, importlib.abc.Loader):\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        return importlib.machinery.ModuleSpec(name, self) if name == 'slow' else None\n"
        "    def exec_module(self, module): ready(); time.sleep(60)\n"
        "sys.meta_path.insert(0, Slow())\n"
        "import threading\n"
        "threading.Thread(target=lambda: __import__('slow')).start()\n"
        "import slow"
    ),
    "compiled": "import ctypes\nlibc = ctypes.CDLL(None)\nready()\nwhile libc.sleep(60): pass\ntime.sleep(60)",
    "thread": "import threading\nthreading.Thread(target=time.sleep, args=(60,)).start()\nready()",
}


@contextmanager
def start(code: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", START + code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_process_wherever_it_is(place: str, number: signal.Signals) -> None:
    with start(PLACES[place]) as process:
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    word = "interrupted" if number is signal.SIGINT else "terminated"
    assert said == f"qparm: {word}; no file was left half written\n"


def test_actions_are_run_and_their_words_said() -> None:
    code = """
def fails():
    raise ValueError
with at_stop(lambda: "one"), at_stop(lambda: None), at_stop(fails), at_stop(lambda: "zwei ä"):
    with at_stop(lambda: "gone"):
        pass
    ready()
    time.sleep(60)
"""
    with start(code) as process:
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=30)
    assert (process.returncode, said) == (143, "qparm: terminated; no file was left half written; zwei ä; one\n")


def test_a_second_signal_does_not_wait_for_the_actions() -> None:
    code = "with at_stop(lambda: (print('acting', flush=True), time.sleep(60))[0]):\n    ready()\n    time.sleep(60)"
    with start(code) as process:
        assert process.stdout is not None
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == "acting\n"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
    assert process.returncode == 130


@pytest.mark.slow
def test_a_signal_that_is_ignored_stays_ignored() -> None:
    code = "ready()\ntime.sleep(1)\nprint('done')"
    ignored = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    process = subprocess.Popen([sys.executable, "-c", ignored + START + code], stdout=subprocess.PIPE, text=True)
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30)[0] == "done\n"
    assert process.returncode == 0


def test_a_forked_child_ends_alone() -> None:
    code = """
pid = os.fork()
if pid == 0:
    time.sleep(60)
ready()
os.kill(pid, 15)
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
time.sleep(0.1)
print("alive")
"""
    with start(code) as process:
        told, _ = process.communicate(timeout=30)
    assert (process.returncode, told) == (0, "143\nalive\n")


def test_a_command_is_interruptible_from_its_first_moments() -> None:
    """No module of size may be loaded before the handlers stand."""
    code = "import sys; import qparm.cli; print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "qparm.stopping" in loaded
    assert not {"click", "numpy", "qparm.cli.commands", "qparm.cell"} & set(loaded)
