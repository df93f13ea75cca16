"""Whether every command ends at once when it is told to, and leaves whole files when it is killed.

Signals at random moments of `plan`, `export`, `design`, `time` and `verify`, from the first to the last: SIGTERM,
SIGINT and SIGKILL. Each run replaces the files of an earlier one, of another seed or period, so that a folder of both
is seen. Judged are the exit code, what is said, how long it takes to end, and what the folder holds afterwards.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from comparisons.tables import save_table

__all__ = ["Outcome", "main"]

# A command may take so long to end (s), on a loaded machine.
_PROMPT = 3.0
_NAMES = {signal.SIGTERM: "SIGTERM", signal.SIGINT: "SIGINT", signal.SIGKILL: "SIGKILL"}
_CELL = Path(__file__).parents[1] / "examples" / "dome.toml"


@dataclass
class Outcome:
    """What was seen of one command and one signal."""

    moments: int = 0
    before: int = 0
    finished: int = 0
    old: int = 0
    new: int = 0
    slowest: float = 0.0
    faults: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Command:
    """A command with two sets of arguments that write different files of the same names to ``{out}``."""

    name: str
    arguments: tuple[tuple[str, ...], tuple[str, ...]]
    judge: Callable[[Path], str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=50, help="of each command and signal")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="*", default=["plan", "export", "design", "time", "verify"])
    parser.add_argument("--signals", nargs="*", default=list(_NAMES.values()))
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    chosen = parser.parse_args()
    # what a shell starts in the background ignores SIGINT, and so would what is started here
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rows, faults = [], []
    with tempfile.TemporaryDirectory() as folder:
        for command in _commands(Path(folder)):
            if command.name not in chosen.commands:
                continue
            for number in (number for number, name in _NAMES.items() if name in chosen.signals):
                found = _shoot(command, number, chosen.moments, chosen.seed, Path(folder) / command.name)
                rows.append([
                    command.name, _NAMES[number], found.moments, found.before, found.finished, found.old, found.new,
                    f"{found.slowest:.2f}", len(found.faults),
                ])  # fmt: skip
                faults += [f"{command.name} {_NAMES[number]}: {fault}" for fault in found.faults]
                print(*rows[-1], *found.faults, sep="  ", flush=True)
    title = "Signals at random moments of commands that replace the files of an earlier run"
    header = (
        ["command", "signal", "moments", "before its first line", "finished", "old files", "new files",
         "slowest to end (s)", "faults"]
    )  # fmt: skip
    print(save_table(chosen.out, "interrupts", title, header, rows))
    sys.exit(1 if faults else 0)


def _commands(folder: Path) -> list[Command]:
    """Make the inputs and return the commands."""
    import tomllib

    import tomli_w

    data = tomllib.loads(_CELL.read_text(encoding="utf-8"))
    data["workpiece"] |= {"elevation": ["20 deg", "40 deg"], "azimuth": ["-10 deg", "10 deg"]}
    data["process"] |= {"rows": 3, "points": 11}
    cell = folder / "cell.toml"
    cell.write_text(tomli_w.dumps(data), encoding="utf-8")
    for seed in ("0", "1"):
        _run("plan", str(cell), "--out", str(folder / f"plan-{seed}"), "--seed", seed, "-q")
    t = np.linspace(0.0, 6.0, 400)
    rng = np.random.default_rng(0)
    np.savetxt(folder / "way.csv", np.stack([np.sin(w * t) for w in rng.uniform(0.3, 2.0, 6)], axis=1), delimiter=",")
    limits = {"velocity": [2.0] * 6, "acceleration": [5.0] * 6, "jerk": [50.0] * 6}
    (folder / "limits.json").write_text(json.dumps(limits), encoding="utf-8")
    vary = ("--vary", "arm.lengths.L1=470 mm:490 mm", "--vary", "arm.lengths.L3=400 mm:430 mm")
    quick = ("--method", "sobol", "--level", "reach", "--plans", "1", "--workers", "2")
    design = ("design", str(cell), *vary, *quick, "--out", "{out}", "-q")
    timed = ("time", str(folder / "way.csv"), "--limits", str(folder / "limits.json"), "--out", "{out}/a.csv", "-q")
    exported = ("export", "trajectory", "--to", "csv", "--out", "{out}/a.csv", "-q")
    verified = ("verify", str(folder / "plan-0" / "trajectory.csv"), "--cell", str(cell), "-q")
    planned = ("plan", str(cell), "--out", "{out}", "-q")
    return [
        Command("plan", ((*planned, "--seed", "0"), (*planned, "--seed", "1")), _plan_state),
        Command("export", tuple((*exported, str(folder / f"plan-{seed}")) for seed in "01"), _one_file_state),  # pyright: ignore[reportArgumentType]
        Command("design", ((*design, "--budget", "40"), (*design, "--budget", "60")), _design_state),
        Command("time", (timed, (*timed, "--period", "8 ms")), _one_file_state),
        Command("verify", (verified, verified), lambda _: "nothing"),
    ]


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "qparm", *arguments], check=False, stdout=subprocess.DEVNULL)


def _plan_state(out: Path) -> str:
    """Return which plan a folder holds, or what is mixed in it."""
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    for name, digest in report["files"].items():
        if _hash(out / name) != digest:
            return f"{name} is not of the plan of report.json"
    return _hash(out / "trajectory.csv")


def _design_state(out: Path) -> str:
    """Return which study a folder holds, or what is mixed in it."""
    told = json.loads((out / "design.json").read_text(encoding="utf-8"))
    lines = (out / "designs.csv").read_text(encoding="utf-8").count("\n") - 1
    if len(told["designs"] if isinstance(told.get("designs"), list) else range(lines)) != lines:
        return "designs.csv and design.json are of two studies"
    return _hash(out / "designs.csv")


def _one_file_state(out: Path) -> str:
    return _hash(out / "a.csv")


def _hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _files(out: Path) -> set[str]:
    return {entry.name for entry in out.iterdir() if not entry.name.startswith("journal.")}


def _shoot(command: Command, number: signal.Signals, moments: int, seed: int, folder: Path) -> Outcome:
    """Run a command that replaces the files of another so often, and signal it each time at another moment."""
    rng = np.random.default_rng([seed, number])
    states, seconds, names = [], 0.0, set()
    for k, arguments in enumerate(command.arguments):
        out = folder / f"{number}-{k}"
        out.mkdir(parents=True)
        start = time.monotonic()
        _run(*(part.format(out=out) for part in arguments))
        seconds = time.monotonic() - start
        states.append(command.judge(out))
        names = _files(out)
    found = Outcome(moments)
    for k in range(moments):
        out = folder / f"{number}-now"
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(folder / f"{number}-0", out)
        for journal in out.glob("journal.*"):
            journal.unlink()
        # every fifth moment is one of the first
        moment = rng.uniform(0.0, 0.3 if k % 5 == 0 else 1.1 * seconds)
        fault = _one(command, number, moment, out, states, names, found)
        if fault:
            found.faults.append(f"after {moment:.3f} s: {fault}")
    return found


def _one(
    command: Command,
    number: signal.Signals,
    moment: float,
    out: Path,
    states: list[str],
    names: set[str],
    found: Outcome,
) -> str:
    """Signal one run and return what is wrong with how it ends, or nothing."""
    arguments = [part.format(out=out) for part in command.arguments[1]]
    # in a group of its own, as in a terminal
    process = subprocess.Popen(
        [sys.executable, "-m", "qparm", *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(moment)
    ready = process.poll() is None and _handles(process.pid)
    over = process.poll() is not None
    start = time.monotonic()
    if number == signal.SIGINT:
        _signal_group(process.pid, number)  # a terminal signals all
    else:
        process.send_signal(number)
    try:
        _, said = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        _signal_group(process.pid, signal.SIGKILL)
        process.communicate()
        return "it does not end"
    took = time.monotonic() - start
    _signal_group(process.pid, signal.SIGKILL)  # workers of a process that was killed
    if over:
        found.finished += 1
    elif not ready:
        found.before += 1
    else:
        found.slowest = max(found.slowest, took)
        wrong = _badly_ended(process.returncode, said, number, found)
        if wrong:
            return wrong
        if took > _PROMPT:
            return f"it takes {took:.1f} s to end"
    if command.name == "verify":
        return ""
    left = sorted(_files(out) - names)
    if left and number != signal.SIGKILL and ready:
        return f"{left} are left"
    if number == signal.SIGKILL and command.name == "plan":
        # whoever uses the folder next finishes what was begun
        _run("export", "trajectory", str(out), "--to", "csv", "--out", str(out.parent / "of-next.csv"), "-q")
    state = command.judge(out)
    if state not in states:
        return f"its files are neither the old nor the new ones ({state})"
    found.old += state == states[0]
    found.new += state == states[1]
    return ""


def _badly_ended(code: int, said: str, number: signal.Signals, found: Outcome) -> str:
    """Return what is wrong with how a run that could handle a signal ended."""
    if number == signal.SIGKILL:
        return "" if code == -number else f"it ends with {code}"
    lines = [line for line in said.splitlines() if not line.startswith("compiling")]
    if code in (0, 3) and not lines:  # it was ending already
        found.finished += 1
        return ""
    if code != 128 + number:
        return f"it ends with {code}: {said[-400:]}"
    if len(lines) != 1 or not lines[0].startswith("qparm: "):
        return f"it says {lines}"
    return ""


def _handles(pid: int) -> bool:
    """Return whether a process has got so far that it handles SIGTERM (Linux tells)."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return False
    caught = next((int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigCgt")), 0)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def _signal_group(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, number)


if __name__ == "__main__":
    main()
