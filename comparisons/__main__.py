"""Every part of the harness, one after the other, and an index of what they wrote.

    python -m comparisons [--out FOLDER] [--quick]

Exit status 1 if a part's own verdict fails; the others run nevertheless.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

__all__ = ["PARTS", "Part", "main"]


@dataclass(frozen=True)
class Part:
    """One module of the harness: its question, and what makes it quick (None: left out then)."""

    module: str
    question: str
    quick: tuple[str, ...] | None = ("--quick",)


PARTS = (
    Part("steps", "Does every way of solving the steps of a plan agree?", ("--limit", "60")),
    Part("equivalence", "Are closed form, active set, QP solvers and cvxpy the same step, and how wrong can they be?"),
    Part("solvers", "What does each solver cost, and what of that is overhead?"),
    Part("methods", "Is the bounded QP worth having, and is WLN more efficient than GPM?", ("--seeds", "1")),
    Part("general", "What does the general method leave undone?", ("--seeds", "2")),
    Part("literal", "And eq. 5 to the letter, without bounds?", None),
    Part("speed", "Do the speed bars hold?", None),
    Part("peers", "How do a step and a pose compare with pink, mink and TRAC-IK?", None),
    Part("reverse_statistics", "What does the paper's improved strategy meet and repair?", ("--seeds", "2")),
    Part("public_paths", "Are whole paths on arms that are not ours valid?", None),
    Part("feeds", "Does the feed leave the path alone?", None),
    Part("strategies", "Which strategy, and do the bars of whole paths hold?", None),
    Part("design", "Which engine finds good designs in few evaluations?", ("--seeds", "1", "--problems", "map-2")),
    Part("design_study", "Does a design study keep its bars, and can F2 tell designs apart?", None),
    Part("timings", "Which timing law, and how near the bound?"),
    Part("verify_files", "Does verify pass every file as written, and none that is off by one per cent?"),
    Part("soak", "Do plans of random cells hold what they claim, judged from their files alone?", ("--cells", "0:3")),
    Part("fuzz", "Does any broken or hostile input make qparm fall over?", ("--count", "500")),
    Part("interrupts", "Does every command end at once when told to, and leave whole files?", ("--moments", "5")),
    Part("reach_map", "How long is a map of 41 x 41 link lengths, and are its verdicts right?"),
)


def _run(part: Part, out: Path, *, quick: bool) -> str:
    """Run one part and return its line of the index."""
    if quick and part.quick is None:
        return "*left out of the quick run*"
    extra = part.quick if quick and part.quick is not None else ()
    start = time.perf_counter()
    code = subprocess.run(
        [sys.executable, "-m", f"comparisons.{part.module}", "--out", str(out), *extra], check=False
    ).returncode
    verdict = "Ran to its end" if code == 0 else f"**exit status {code}: see its tables**"
    return f"{verdict} ({time.perf_counter() - start:.0f} s)"


def _written(out: Path, since: dict[Path, int]) -> list[Path]:
    """Return the tables and figures that are new or changed, figures last."""
    files = [*sorted(out.glob("*.md")), *sorted(out.glob("*.png"))]
    return [file for file in files if file.name != "index.md" and since.get(file) != file.stat().st_mtime_ns]


def _entry(file: Path) -> str:
    if file.suffix == ".png":
        return f"- ![{file.stem}]({file.name})"
    title = file.read_text(encoding="utf-8").split("\n", 1)[0].strip("*")
    data = f" ([CSV]({file.stem}.csv))" if file.with_suffix(".csv").exists() else ""
    return f"- [{file.stem if title.startswith('![') else title}]({file.name}){data}"


def main() -> int:
    """Run the parts, write ``index.md``; return 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--quick", action="store_true", help="few steps, few seeds, no speed bars")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    lines = ["# Comparisons", "", "Tables and figures of one run of `python -m comparisons`.", ""]
    failed = False
    for part in PARTS:
        before = {file: file.stat().st_mtime_ns for file in out.iterdir()}
        verdict = _run(part, out, quick=arguments.quick)
        failed |= "exit status" in verdict
        lines += [f"## {part.module}", "", f"{part.question} {verdict}", ""]
        lines += [*(_entry(file) for file in _written(out, before)), ""]
    text = "\n".join(lines)
    (out / "index.md").write_text(text, encoding="utf-8")
    print(text)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
