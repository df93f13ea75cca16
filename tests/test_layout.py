"""The layout in the docs is that of the code. `python tests/test_layout.py > docs/layout.md` writes it anew."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "src" / "qparm"


def first_sentence(file: Path) -> str:
    """Return the first sentence of a module's docstring, without its full stop."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    paragraph = " ".join(text.split("\n\n")[0].split())
    return paragraph.split(". ")[0].removesuffix(".")


def layout() -> str:
    """Return the page: every room with what it is for, every module with its first sentence."""
    lines = [
        "# Layout",
        "",
        "Every module of `src/qparm` in one sentence, its own: `tests/test_layout.py` writes this page and holds it to",
        "the code. Rooms stand in the order in which they may import each other, from the bottom up.",
    ]
    top = sorted(file for file in SOURCES.glob("*.py") if file.name not in ("__init__.py", "__main__.py"))
    lines += ["", "## qparm", "", f"{first_sentence(SOURCES / '__init__.py')}.", ""]
    lines += [f"- `{file.stem}`: {first_sentence(file)}" for file in top]
    for room in rooms():
        where = room.relative_to(SOURCES).as_posix()
        lines += ["", f"## {where}", "", f"{first_sentence(room / '__init__.py')}.", ""]
        modules = sorted(file for file in room.glob("*.py") if not file.stem.startswith("__"))
        lines += [f"- `{file.stem}`: {first_sentence(file)}" for file in modules]
    return "\n".join(lines) + "\n"


def rooms() -> list[Path]:
    """Return the folders, those that may import none of the others first, each followed by the rooms in it."""
    from test_pipeline import LAYERS

    found: list[Path] = []
    for name in LAYERS:
        if (SOURCES / name).is_dir():
            inner = sorted(path.parent for path in (SOURCES / name).rglob("__init__.py"))
            found += inner
    return found


def test_the_layout_in_the_docs_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "layout.md").read_text(encoding="utf-8") == layout()


def test_every_file_that_the_docs_name_is_there() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "comparisons").glob("*.md")]
    found = 0
    for page in pages:
        if page.name == "CHANGELOG.md":
            continue
        for name in re.findall(r"`((?:\w+/)*\w+\.py)`", page.read_text(encoding="utf-8")):
            places = [ROOT / name, SOURCES / name, ROOT / "comparisons" / name]
            assert any(place.exists() for place in places), f"{page.name} names {name}"
            found += 1
    assert found > 40


def test_every_module_says_what_it_is() -> None:
    for file in SOURCES.rglob("*.py"):
        assert len(first_sentence(file)) > 10, file


if __name__ == "__main__":
    print(layout(), end="")
