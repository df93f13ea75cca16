"""Whether any input makes qparm fall over: thousands of broken and hostile ones, by every command.

    python -m comparisons.fuzz [--count 10000] [--seed 0] [--first INDEX] [--kind NAME] [--repeat INDEX] [--out FOLDER]

Valid files of every kind (`fuzz_seeds`) are changed (`fuzz_mutations`) and given to the command that reads them, each
in a forked child of its own with limits of time and memory, while everything is imported already. A table says for each
kind how the runs ended. Exit status 1 if any of them printed a traceback, ended with code 1 or by a signal, took more
than 6 s of CPU or 1 GB, or let numpy warn. `--repeat` runs one input again, shows what it prints and keeps it.

A changed cell that is valid and larger than the tiny one is only read: to plan it is work, and no fault.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

# a thread in the parent would be missing in its children
for _variable in (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "ARROW_NUM_THREADS",
):
    os.environ[_variable] = "1"

from comparisons.fuzz_mutations import mutated, mutated_arguments, replaced_file  # noqa: E402
from comparisons.fuzz_seeds import KINDS, Kind, make_seeds  # noqa: E402
from comparisons.tables import save_table  # noqa: E402

__all__ = ["Ended", "main"]

MOST_SECONDS, MOST_BYTES = 6.0, 1 << 30
# The child is stopped here (s of CPU, s by the clock, bytes of address space beyond the parent's).
_STOPPED, _WALL, _SPACE = 20, 240, 6 << 30
_CODES = (0, 2, 3, 4, 5)
_REPLACED = 0.03
_TO = {"csv": ".csv", "npz": ".npz", "json": ".json", "stream": ".csv", "rapid": ".mod", "krl": ".src", "yaml": ".yaml"}


@dataclass(frozen=True)
class Ended:
    """How one input ended.

    Attributes
    ----------
    code : int
        Exit code, negative for a signal.
    seconds : float
        CPU.
    size : int
        The most memory that it had, what it shares with the parent included (bytes).
    text : str
        What the command printed.
    """

    code: int
    seconds: float
    size: int
    text: str

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with it, in words of the table; empty if nothing is."""
        found = []
        if "Traceback (most recent call last)" in self.text:
            found.append("traceback")
        if self.code not in _CODES:
            found.append("exit 1" if self.code == 1 else f"code {self.code}")
        if self.seconds > MOST_SECONDS:
            found.append("CPU")
        if self.size > MOST_BYTES or "more memory than there is" in self.text:
            found.append("memory")
        if "Warning: " in self.text:
            found.append("warning")
        return tuple(found)


def _arguments(kind: Kind, rng: random.Random) -> list[str]:
    arguments = mutated_arguments(rng) if kind.name == "options" else list(kind.arguments)
    to = rng.choice(list(_TO))
    names = {"{out}": "out", "{to}": to, "{file}": f"x{_TO[to]}"}
    for name, value in names.items():
        arguments = [argument.replace(name, value) for argument in arguments]
    return arguments


def run_one(index: int, seed: int, kind: Kind, seeds: Path, work: Path) -> tuple[Ended, list[str]]:
    """Change one input, run the command that reads it in a child and return how it ended, and the command."""
    rng = random.Random(f"{seed}/{index}")
    out = work / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    arguments = _arguments(kind, rng)
    file = work / kind.file if kind.file else None
    try:
        if file is not None:
            original = (seeds / kind.file).read_bytes()
            if rng.random() < _REPLACED:
                replaced_file(file, rng)
            else:
                file.write_bytes(mutated(original, rng, binary=kind.binary, suffix=file.suffix))
        if kind.name == "journal" and os.path.lexists(work / "journal.jsonl"):
            (work / "journal.jsonl").rename(out / "journal.jsonl")
        return _in_child(arguments, kind, work), arguments
    finally:
        if file is not None:
            _restore(seeds / kind.file, file)
        else:  # options may write anywhere in the folder: what a later input finds there must not depend on them
            shutil.rmtree(work)
            shutil.copytree(seeds, work)


def _restore(source: Path, file: Path) -> None:
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)
    shutil.copy2(source, file)


def _in_child(arguments: list[str], kind: Kind, work: Path) -> Ended:
    said = work / "said.txt"
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        _be_child(arguments, kind, work, said)
    code, seconds, size = _wait(child, start)
    return Ended(code, seconds, size, said.read_text(encoding="utf-8", errors="replace"))


def _wait(child: int, start: float) -> tuple[int, float, int]:
    while True:
        pid, status, usage = os.wait4(child, os.WNOHANG)
        if pid:
            break
        if time.monotonic() - start > _WALL:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.001)
    code = os.waitstatus_to_exitcode(status)
    return code, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024


def _be_child(arguments: list[str], kind: Kind, work: Path, said: Path) -> None:
    """Run a command as the program does, and end."""
    code = 1
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (_STOPPED, _STOPPED + 1))
        space = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (space + _SPACE, space + _SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (_SPACE, _SPACE))
        os.chdir(work)
        for number, flags in (
            (0, os.O_RDONLY),
            (1, os.O_WRONLY | os.O_CREAT | os.O_TRUNC),
            (2, os.O_WRONLY | os.O_APPEND),
        ):
            os.dup2(os.open(os.devnull if number == 0 else said, flags, 0o600), number)
        # whatever the parent had in their place
        sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))  # noqa: SIM115
        code = _run(arguments, kind)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _run(arguments: list[str], kind: Kind) -> int:
    from qparm import cli

    if kind.reads_cell and _is_larger(arguments[1]):
        return 0
    try:
        cli.main(arguments)
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else 0


def _is_larger(cell: str) -> bool:
    """Return whether a cell is valid and more work than the tiny one."""
    import qparm

    try:
        loaded = qparm.Cell.load(cell)
    except qparm.QparmError:
        return False
    path, chain = loaded.tool_path(), loaded.chain()
    way = sum(row.length for row in path.rows)
    links = sum(float(abs(joint.transform_previous_joint[:3, 3]).max()) for joint in chain.joints)
    variables = loaded.design.variables if loaded.design is not None else ()
    return (
        path.point_count > 12
        or way / loaded.process.feed > 20.0
        or links > 5.0
        or len(variables) > 2
        or float(min(chain.velocity.min(), chain.acceleration.min(), chain.jerk.min())) < 0.05
    )


def _warm_up(seeds: Path, work: Path) -> None:
    """Run every command once on the valid files, so that children find everything imported and compiled."""
    from qparm import cli

    here = Path.cwd()
    os.chdir(work)
    try:
        for kind in KINDS:
            if kind.name == "options":
                continue
            (work / "out").mkdir(exist_ok=True)
            arguments = _arguments(kind, random.Random(0))
            try:
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                    cli.main([*arguments, *(() if kind.arguments[0] in ("check", "export") else ("-q",))])
            except SystemExit as ended:
                if ended.code not in (0, 3):
                    raise RuntimeError(f"the valid input of {kind.name!r} ends with {ended.code}") from None
            shutil.rmtree(work / "out", ignore_errors=True)
    finally:
        os.chdir(here)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def main() -> int:
    """Run the fuzzer and return 1 if anything fell over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="inputs, all kinds in turn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="index of the first input")
    parser.add_argument("--kind", action="append", choices=[kind.name for kind in KINDS], help="only of this kind")
    parser.add_argument("--repeat", type=int, metavar="INDEX", help="run this input again and keep it")
    parser.add_argument(
        "--out", type=Path, default=Path("results"), help="where the table, and faulty inputs, are written"
    )
    options = parser.parse_args()
    kinds = [kind for kind in KINDS if options.kind is None or kind.name in options.kind]
    with tempfile.TemporaryDirectory(prefix="qparm-fuzz-") as folder:
        seeds, work = Path(folder) / "seeds", Path(folder) / "work"
        seeds.mkdir()
        make_seeds(seeds)
        shutil.copytree(seeds, work)
        print("loading every command")
        _warm_up(seeds, work)
        if options.repeat is not None:
            return _repeat(options.repeat, options.seed, seeds, work, options.out)
        return _fuzz(range(options.first, options.first + options.count), options.seed, kinds, seeds, work, options.out)


def _fuzz(indices: range, seed: int, kinds: list[Kind], seeds: Path, work: Path, out: Path) -> int:
    counts: dict[str, Counter[str]] = {kind.name: Counter() for kind in kinds}
    slowest: dict[str, float] = {}
    largest: dict[str, float] = {}
    faulty = 0
    start = time.monotonic()
    try:
        for done, index in enumerate(indices, 1):
            # the kind follows from the index alone, so that --repeat finds it whatever kinds were chosen
            kind = KINDS[index % len(KINDS)]
            if kind not in kinds:
                continue
            ended, arguments = run_one(index, seed, kind, seeds, work)
            count = counts[kind.name]
            count["all"] += 1
            count[f"exit {ended.code}"] += 1
            slowest[kind.name] = max(slowest.get(kind.name, 0.0), ended.seconds)
            largest[kind.name] = max(largest.get(kind.name, 0.0), ended.size / 1e6)
            for fault in ended.faults:
                count[fault if fault != "exit 1" else "exit 1 "] += 1
            if ended.faults:
                faulty += 1
                last = ended.text.strip().splitlines()[-1:] or [""]
                command, what = " ".join(arguments)[:100], ", ".join(ended.faults)
                print(f"{index}: {kind.name}: {what}: qparm {command}: {last[0][:200]}", flush=True)
            if done % 500 == 0:
                print(f"  {done} of {len(indices)}, {faulty} faulty, {time.monotonic() - start:.0f} s", flush=True)
    except KeyboardInterrupt:
        print("interrupted; the table is of what was run")
    header = ["kind", "inputs", "exit 0", "exit 2", "exit 3", "exit 4, 5", "tracebacks", "exit 1 or signal", "over 6 s",
              "over 1 GB", "warnings", "longest", "largest"]  # fmt: skip
    rows = []
    for name, count in counts.items():
        seconds, size = f"{slowest.get(name, 0.0):.1f} s", f"{largest.get(name, 0.0):.0f} MB"
        odd = sum(n for what, n in count.items() if what == "exit 1 " or what.startswith("code "))
        rows.append([name, *(str(n) for n in (count["all"], count["exit 0"], count["exit 2"], count["exit 3"],
                     count["exit 4"] + count["exit 5"], count["traceback"], odd, count["CPU"], count["memory"],
                     count["warning"])), seconds, size])  # fmt: skip
    totals = [str(sum(int(row[k]) for row in rows)) for k in range(1, 11)]
    rows.append(
        ["all", *totals, f"{max(slowest.values(), default=0):.1f} s", f"{max(largest.values(), default=0):.0f} MB"]
    )
    print(save_table(out, "fuzz", f"{totals[0]} changed inputs, seed {seed}", header, rows))
    return 1 if faulty else 0


def _repeat(index: int, seed: int, seeds: Path, work: Path, out: Path) -> int:
    """Run one input again; keep it and all that its command reads."""
    kind = KINDS[index % len(KINDS)]
    kept = out / f"fuzz_{seed}_{index}"
    shutil.rmtree(kept, ignore_errors=True)
    rng = random.Random(f"{seed}/{index}")
    arguments = _arguments(kind, rng)
    shutil.copytree(seeds, kept)
    if kind.file:
        file = kept / kind.file
        if rng.random() < _REPLACED:
            replaced_file(file, rng)
        else:
            file.write_bytes(mutated((seeds / kind.file).read_bytes(), rng, binary=kind.binary, suffix=file.suffix))
    ended, _ = run_one(index, seed, kind, seeds, work)
    print(ended.text)
    faults = ", ".join(ended.faults) or "well"
    print(f"exit code {ended.code}, {ended.seconds:.1f} s of CPU, {ended.size / 1e6:.0f} MB; {faults}")
    print(f"kept in {kept}; there: qparm {' '.join(arguments)}")
    return 1 if ended.faults else 0


if __name__ == "__main__":
    sys.exit(main())
