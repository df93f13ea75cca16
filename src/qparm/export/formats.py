"""The formats in which a trajectory is handed on, and the one call that writes any of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput, OutputError
from qparm.export.abb_rapid import write_rapid
from qparm.export.joint_trajectory_json import write_json
from qparm.export.joint_trajectory_mcap import write_mcap
from qparm.export.joint_trajectory_rosbag2 import bag_files, write_rosbag2
from qparm.export.joint_trajectory_yaml import write_yaml
from qparm.export.kuka_krl import krl_files, write_krl
from qparm.export.sampled import SampledTrajectory, at_knots, at_period, at_steps, at_ticks
from qparm.export.servo_stream import write_stream
from qparm.export.trajectory_csv import write_csv
from qparm.export.trajectory_npz import write_npz
from qparm.export.trajectory_parquet import write_parquet
from qparm.extras import load_extra
from qparm.files.output import is_staging, require_file, require_writable, staged
from qparm.verify import MotionReport, read_motion, verify_motion

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.path import Trajectory

__all__ = ["FORMATS", "Exported", "Format", "export_trajectory"]


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    write : callable
        ``write(sampled, file)``.
    sample : callable
        ``sample(trajectory, units, period)``.
    period : float or None
        By default (s); None where the default are the trajectory's own knots.
    extension : str
        Of the file, with its dot; empty for a folder.
    verdict : bool
        Whether the format can say that the trajectory must not be executed.
    modules : tuple of str
        Of optional packages that it needs.
    instead : str
        A format that works without them.
    files : callable
        ``files(file)``: all that is written; by default the file alone.
    """

    write: Callable[[SampledTrajectory, Path], None]
    sample: Callable[..., SampledTrajectory]
    period: float | None
    extension: str
    verdict: bool = False
    modules: tuple[str, ...] = ()
    instead: str = ""
    files: Callable[[Path], tuple[Path, ...]] = lambda file: (file,)


_table = partial(Format, sample=at_period, period=0.004)
_message = partial(Format, sample=at_knots, period=None, verdict=True)
_program = partial(Format, sample=at_steps, period=0.05)

FORMATS: dict[str, Format] = {
    "csv": _table(write_csv, extension=".csv"),
    "npz": _table(write_npz, extension=".npz", verdict=True),
    "parquet": _table(
        write_parquet, extension=".parquet", verdict=True, modules=("pyarrow.parquet",), instead="--to npz"
    ),
    "stream": Format(write_stream, at_ticks, 0.004, ".csv"),
    "json": _message(write_json, extension=".json"),
    "yaml": _message(write_yaml, extension=".yaml", modules=("yaml",), instead="--to json"),
    "mcap": _message(write_mcap, extension=".mcap", modules=("mcap_ros2.writer",), instead="--to json"),
    "rosbag2": _message(
        write_rosbag2, extension="", modules=("rosbags.rosbag2",), instead="--to mcap", files=bag_files
    ),
    "krl": _program(write_krl, extension=".src", files=krl_files),
    "rapid": _program(write_rapid, extension=".mod"),
}


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    files : tuple of Path
    samples : int
    duration : float
        From the first sample to the last (s).
    report : MotionReport or None
        What `qparm verify` says of the file; None if no cell was given.
    """

    files: tuple[Path, ...]
    samples: int
    duration: float
    report: MotionReport | None = None


def export_trajectory(
    trajectory: Trajectory,
    file: str | Path,
    *,
    to: str,
    units: Sequence[str],
    period: float | None = None,
    allow_failures: bool = False,
    cell: Cell | None = None,
) -> Exported:
    """Write a trajectory in one of :data:`FORMATS`, whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    file : str or Path
        With the format's extension; a folder for ``"rosbag2"``.
    to : str
        The format.
    units : sequence of str
        ``"m"`` or ``"rad"`` for each joint, such as ``chain.units``.
    period : float, optional
        Seconds between samples; at most between those of controller programs. By default that of the format.
    allow_failures : bool
        Write a trajectory that must not be executed, in a format that can say so.
    cell : Cell, optional
        That the motion is for: the file is read back and verified against it.

    Returns
    -------
    Exported
        Its ``report`` says what is wrong with the file; it is written all the same.

    Raises
    ------
    InvalidInput
        If the format is unknown or does not take this arm, the extension is another, the period is not usable, or the
        trajectory must not be executed; if the cell has other joints, or the samples are too far apart to be verified.
    PackageMissing
        If the format needs a package that is not installed.
    OutputError
        If the file cannot be written.
    """
    file = Path(file)
    if to not in FORMATS:
        raise InvalidInput(f"there is no format {to!r}; there are {', '.join(FORMATS)}")
    format_ = FORMATS[to]
    if len(units) != len(trajectory.joint_names) or not set(units) <= {"m", "rad"}:
        raise InvalidInput(f"units must be 'm' or 'rad' for each of {len(trajectory.joint_names)} joints, not {units}")
    if format_.extension and file.suffix.lower() != format_.extension:
        raise InvalidInput(f"a file of the format {to} must be named *{format_.extension}, not {file.name!r}")
    if not trajectory.executable:
        _require_allowed(trajectory, to, allow_failures)
    for module in format_.modules:
        load_extra(module, instead=format_.instead)
    written = format_.files(file)
    for entry in written:
        require_file(entry)
    sampled = format_.sample(trajectory, units, period if period is not None else format_.period)
    if format_.extension:
        with staged(file.parent) as folder:
            format_.write(sampled, folder / file.name)
    else:
        _write_folder(format_, sampled, file, written)
    report = None if cell is None else verify_motion(read_motion(file, cell), cell)
    return Exported(written, len(sampled.t), float(sampled.t[-1] - sampled.t[0]), report)


def _require_allowed(trajectory: Trajectory, to: str, allow_failures: bool) -> None:
    reasons = "".join(f"\n  - {reason}" for reason in trajectory.reasons)
    if not FORMATS[to].verdict:
        able = ", ".join(name for name, format_ in FORMATS.items() if format_.verdict)
        raise InvalidInput(
            f"the trajectory must not be executed, and {to} has no place to say so; these have, with"
            f" --allow-failures: {able}{reasons}"
        )
    if not allow_failures:
        raise InvalidInput(f"the trajectory must not be executed; --allow-failures writes it all the same{reasons}")


def _write_folder(format_: Format, sampled: SampledTrajectory, folder: Path, files: tuple[Path, ...]) -> None:
    """Write a format that is a folder of files; in the place of an earlier one, but of nothing else."""
    existed = folder.exists()
    require_writable(folder)
    known = {entry.name for entry in files}
    strange = sorted(entry.name for entry in folder.iterdir() if entry.name not in known and not is_staging(entry))
    if strange:
        raise OutputError(folder, f"it holds {strange[0]!r}, which is no part of the export; name another folder")
    try:
        with staged(folder) as staging:
            format_.write(sampled, staging / folder.name)
            for entry in (staging / folder.name).iterdir():
                entry.rename(staging / entry.name)
            (staging / folder.name).rmdir()
    except BaseException:
        if not existed:
            folder.rmdir()
        raise
