"""Workpiece and process of a cell: a surface and its raster, or a list of poses."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from qparm.cell.part import Part, Pose, file_of_cell
from qparm.cell.quantities import (
    Angle,
    AnglePair,
    Length,
    LinearVelocity,
    ascending,
    between,
    not_negative,
    positive,
    problem,
)

if TYPE_CHECKING:
    from qparm.surface import ParametricSurface, PoseTable, SphericalZone

__all__ = ["AnyWorkpiece", "PoseList", "Process", "SelfMotion", "SphereZone", "Workpiece", "too_large"]


class Workpiece(Part):
    """What every shape of workpiece says of itself, so that nobody asks which one it is."""

    def surface(self) -> ParametricSurface | None:
        """Return the surface in the workpiece frame; None if it is not known."""
        return None

    @property
    def surface_known(self) -> bool:
        """Whether distances from the workpiece are known, and so clearances."""
        return self.surface() is not None

    @property
    def turns_on_the_spot(self) -> bool:
        """Whether the tool may turn on its path without going on."""
        return False

    @property
    def between_rows(self) -> str:
        """How the tool gets from row to row, in words; empty where the process says it."""
        return ""

    def wide_gaps(self) -> list[tuple[int, int, float, float]]:
        """Return gaps at which a new row may be meant to begin (:func:`qparm.surface.wide_gaps`)."""
        return []


class SphereZone(Workpiece):
    """The workpiece: a zone of a sphere and where its frame stands."""

    shape: Literal["sphere zone"]
    radius: Length
    elevation: AnglePair
    azimuth: AnglePair
    pose: Pose

    _positive = field_validator("radius")(positive)
    _ascending = field_validator("elevation", "azimuth")(ascending)

    @field_validator("elevation")
    @classmethod
    def _within_poles(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not (-math.pi / 2 < value[0] and value[1] < math.pi / 2):
            raise problem("must lie within -90 deg and 90 deg, poles excluded: a row there has no length")
        return value

    @field_validator("azimuth")
    @classmethod
    def _one_turn(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[1] - value[0] > 2 * math.pi * (1 + 1e-12):
            raise problem("must span no more than 360 deg")
        return value

    def surface(self) -> SphericalZone:
        """Return the surface in the workpiece frame."""
        from qparm.surface import SphericalZone

        return SphericalZone(radius=self.radius, elevation=self.elevation, azimuth=self.azimuth)

    def described(self) -> str:
        """Return the shape and its measures in words."""
        (e0, e1), (a0, a1) = ([math.degrees(x) for x in pair] for pair in (self.elevation, self.azimuth))
        return (
            f"{self.shape}, radius {self.radius * 1e3:.5g} mm, elevation {e0:.5g} to {e1:.5g} deg,"
            f" azimuth {a0:.5g} to {a1:.5g} deg, {self.surface().area:.3g} m^2"
        )


class PoseList(Workpiece):
    """The workpiece: poses that come from elsewhere, and where their frame stands.

    ``poses`` is the whole path of a CSV file, or the text itself (of several lines).
    """

    shape: Literal["pose list"]
    poses: str
    turning_radius: Length = 0.1
    pose: Pose = Pose()

    _positive = field_validator("turning_radius")(positive)

    @field_validator("poses")
    @classmethod
    def _whole_path(cls, value: str, info: ValidationInfo) -> str:
        return value if "\n" in value else file_of_cell(value, info)

    @cached_property
    def table(self) -> PoseTable:
        """The poses as they were read."""
        from qparm.surface import read_pose_list

        return read_pose_list(self.poses)

    @property
    def turns_on_the_spot(self) -> bool:
        """Poses may differ in their rotation alone."""
        return True

    @property
    def between_rows(self) -> str:
        """There is no surface to follow."""
        return "straight from row to row"

    def wide_gaps(self) -> list[tuple[int, int, float, float]]:
        """Return gaps that are many times wider than the others of their row."""
        from qparm.surface import wide_gaps

        return wide_gaps(self.table)

    def described(self) -> str:
        """Return where the poses come from."""
        source = "in the cell" if "\n" in self.poses else self.poses
        return f"{self.shape} {source}; the surface is not known"


AnyWorkpiece = Annotated[SphereZone | PoseList, Field(discriminator="shape")]


class SelfMotion(Part):
    """The self-motion areas at the row ends."""

    points: int = Field(default=0, ge=0, strict=True)
    transition: Literal["follow", "lift"] = "follow"
    lift: Length = 0.0
    row_end: Literal["stop", "flow"] = "stop"
    overrun: Length = 0.01

    _not_negative = field_validator("lift")(not_negative)
    _positive = field_validator("overrun")(positive)


# A path beyond this is not planned within a day, nor within memory (6 MB a row).
_MOST_POINTS, _MOST_ROWS = 200_000, 5_000


def too_large(table: PoseTable) -> str:
    """Return what is wrong with the size of a list of poses, empty if nothing is."""
    poses, rows = len(table.row), int(table.row[-1]) + 1
    if poses > _MOST_POINTS:
        return f"{poses:,} poses are more than {_MOST_POINTS:,}: cut the list into parts"
    if rows > _MOST_ROWS:
        return f"{rows:,} rows are more than {_MOST_ROWS:,}: cut the list into parts, or join rows"
    return ""


def _has_poses(info: ValidationInfo) -> bool:
    """Return whether the cell's workpiece is a list of poses."""
    return bool((info.context or {}).get("pose list"))


class Process(Part):
    """The raster and what counts as done. A pose list has rows and points of its own, and no surface to stand off."""

    rows: Annotated[int, Field(ge=1, le=_MOST_ROWS, strict=True)] | None = Field(default=None, validate_default=True)
    points: Annotated[int, Field(ge=2, le=_MOST_POINTS, strict=True)] | None = Field(
        default=None, validate_default=True
    )
    feed: LinearVelocity
    stand_off: Length = 0.0
    clearance: Length = 0.02
    position_tolerance: Length = 1e-6
    rotation_tolerance: Angle = 1e-5
    position_between: Length = 5e-6
    rotation_between: Angle = 2e-5
    tool_spin: Literal["fixed", "free"] = "fixed"
    tool_tilt: Angle = 0.0
    jump: Angle = math.radians(50)
    jump_prismatic: Length | None = None
    self_motion: SelfMotion = SelfMotion()

    _positive = field_validator("jump")(positive)
    _not_negative = field_validator("stand_off", "clearance")(not_negative)
    _feed = field_validator("feed")(between(1e-6, 100.0, "0.001 mm/s and 100 m/s"))
    _position = field_validator("position_tolerance", "position_between")(between(1e-9, 0.01, "0.001 um and 10 mm"))
    _rotation = field_validator("rotation_tolerance", "rotation_between")(
        between(1e-9, math.radians(10), "0.001 urad and 10 deg")
    )
    _tilt = field_validator("tool_tilt")(between(0.0, math.radians(60), "0 and 60 deg"))

    @field_validator("rows", "points")
    @classmethod
    def _of_a_raster(cls, value: int | None, info: ValidationInfo) -> int | None:
        if value is None and not _has_poses(info):
            raise problem("is missing")
        if value is not None and _has_poses(info):
            raise problem("a pose list has rows and points of its own; leave this out")
        return value

    @field_validator("stand_off")
    @classmethod
    def _of_a_surface(cls, value: float, info: ValidationInfo) -> float:
        if value and _has_poses(info):
            raise problem("a pose list has no surface to stand off from; its poses are those of the tool")
        return value

    @field_validator("points")
    @classmethod
    def _not_too_many(cls, value: int | None, info: ValidationInfo) -> int | None:
        rows = info.data.get("rows")
        if rows is not None and value is not None and rows * value > _MOST_POINTS:
            raise problem(f"{rows} rows of {value} points are more than {_MOST_POINTS:,} in all")
        return value

    @field_validator("jump_prismatic")
    @classmethod
    def _jump_positive(cls, value: float | None) -> float | None:
        return value if value is None else positive(value)

    @field_validator("self_motion")
    @classmethod
    def _fits_row(cls, value: SelfMotion, info: ValidationInfo) -> SelfMotion:
        points = info.data.get("points")
        if points is not None and value.points > points // 2:
            raise problem(f"points = {value.points} is more than half of a row of {points} points")
        if value.transition == "lift" and _has_poses(info):
            raise problem(
                'a pose list has no surface to lift off; transition must be "follow": straight from row to row'
            )
        if value.row_end == "flow" and _has_poses(info):
            raise problem(
                'a pose list has no surface to turn on; row_end must be "stop". Poses of one row are passed without a'
                " stop: put the turn's poses in between and leave the rows one"
            )
        if value.transition == "lift" and value.lift == 0:
            raise problem('transition = "lift" needs a lift, such as lift = "30 mm"')
        return value
