"""All files of a design study in one folder: either whole or absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.design.report import study_data
from qparm.export.designs_csv import write_designs_csv
from qparm.files.output import staged
from qparm.view.design import STUDY_PICTURES, draw_study

if TYPE_CHECKING:
    from qparm.design.study import DesignStudy

__all__ = ["CHOSEN_FILE", "JOURNAL_FILE", "STUDY_FILES", "write_study"]

DESIGNS_FILE, DESIGN_REPORT_FILE, CHOSEN_FILE, JOURNAL_FILE = (
    "designs.csv",
    "design.json",
    "chosen.toml",
    "journal.jsonl",
)


# What a study may write beside its table and its report, and another one in the same folder may not.
_AT_TIMES = (CHOSEN_FILE, *STUDY_PICTURES)
STUDY_FILES = (DESIGNS_FILE, DESIGN_REPORT_FILE, *_AT_TIMES)


def write_study(study: DesignStudy, folder: str | Path, *, pictures: bool = True) -> tuple[str, ...]:
    """Write a study's files and return their names.

    Parameters
    ----------
    study : DesignStudy
    folder : str or Path
        Made if it does not exist; files of these names in it are replaced. Where an earlier study was written there,
        its files that this one does not have are removed.
    pictures : bool

    Raises
    ------
    OutputError
        If the folder cannot be written to; nothing is left half written.
    """
    folder = Path(folder)
    earlier = (folder / DESIGN_REPORT_FILE).is_file()
    with staged(folder, obsolete=_AT_TIMES if earlier else ()) as staging:
        write_designs_csv(study, staging / DESIGNS_FILE)
        text = json.dumps(study_data(study), indent=1, allow_nan=False) + "\n"
        (staging / DESIGN_REPORT_FILE).write_text(text, encoding="utf-8")
        cell = study.cell()
        if cell is not None:
            cell.save(staging / CHOSEN_FILE, folder=folder)
        if pictures:
            draw_study(study, staging)
        names = tuple(sorted(file.name for file in staging.iterdir() if file.is_file()))
    return names
