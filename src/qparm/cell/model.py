"""The cell: arm, workpiece, process and home in one TOML file, validated all at once.

Every quantity with a dimension is written with its unit, as a string. What is wrong is reported
together, each problem with the path of its key.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pydantic
from pydantic import Field, field_validator

from qparm.cell.arm import AnyArm, Arm, PrismaticJoint, RevoluteJoint
from qparm.cell.design import Design, DesignVariable, changed, own_value, wrong_design
from qparm.cell.messages import told, toml_data
from qparm.cell.part import Part, Pose
from qparm.cell.quantities import DIMENSION_OF_KIND, Name, problem, quantity
from qparm.cell.stiffness import missing_stiffness, wrong_stiffness
from qparm.cell.urdf import UrdfArm
from qparm.cell.work import AnyWorkpiece, PoseList, Process, SelfMotion, SphereZone, too_large
from qparm.errors import CellError, InvalidInput
from qparm.files.output import staged_file

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain
    from qparm.robot.compliance import Elasticity

# Poses that are so many times farther away than the arm reaches are no misplaced part, but in another unit.
_FAR = 20.0

__all__ = [
    "Arm",
    "Cell",
    "Design",
    "DesignVariable",
    "Pose",
    "PoseList",
    "PrismaticJoint",
    "Process",
    "RevoluteJoint",
    "SelfMotion",
    "SphereZone",
    "UrdfArm",
]


class Cell(Part):
    """One cell: arm, workpiece, process; and what of it may be chosen (:mod:`qparm.design`).

    Examples
    --------
    >>> cell = Cell.load("examples/dome.toml")  # doctest: +SKIP
    >>> cell.chain().n  # doctest: +SKIP
    8
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Name = "cell"
    arm: AnyArm
    workpiece: AnyWorkpiece
    process: Process
    design: Design | None = None

    @field_validator("schema_version", mode="before")
    @classmethod
    def _whole(cls, value: object) -> object:
        # true and 1.0 are equal to 1 in Python, so Literal lets them pass
        if isinstance(value, (bool, float)):
            raise problem(f"must be the whole number 1, not {str(value).lower()}")
        return value

    def __repr__(self) -> str:
        return f"Cell({self.name!r}: arm {self.arm.name!r}, {len(self.arm.joints)} joints; {self.workpiece.shape})"

    __str__ = __repr__

    # --- in and out ------------------------------------------------------------------------------

    @classmethod
    def load(cls, source: Cell | Mapping[str, Any] | str | Path) -> Cell:
        """Return the cell of a TOML file, of a dictionary, or the cell itself.

        Raises
        ------
        CellError
            With everything that is wrong, each problem with the path of its key.
        """
        if isinstance(source, Cell):
            return source
        if isinstance(source, Mapping):
            return _validated(dict(source), "cell", Path.cwd())
        if not isinstance(source, (str, os.PathLike)):
            raise InvalidInput(f"a cell is a TOML file, a dictionary or a Cell, not {source!r}")
        if not str(source):
            raise InvalidInput("a cell is a TOML file, a dictionary or a Cell; the file's name is empty")
        return _validated(toml_data(source), str(source), Path(source).resolve().parent)

    def to_dict(self) -> dict[str, Any]:
        """Return the cell with every default filled in and every quantity as a string with its SI unit.

        ``Cell.load(cell.to_dict()) == cell``.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    def with_process(self, changes: Mapping[str, Any]) -> Cell:
        """Return the cell with other values of ``[process]``, such as ``{"tool_spin": "free"}``.

        A value of None leaves the cell's own.

        Raises
        ------
        CellError
            If a value is not valid.
        """
        given = {key: value for key, value in changes.items() if value is not None}
        if not given:
            return self
        data = self.to_dict()
        data["process"] |= given
        return Cell.load(data)

    def with_values(self, values: Mapping[str, float]) -> Cell:
        """Return the cell with other values of some quantities, without its ``[design]`` table.

        Parameters
        ----------
        values : mapping of str to float
            Path of each quantity, such as ``"arm.lengths.L1"``, and its value (SI).

        Raises
        ------
        CellError
            If the cell is not valid with them.
        InvalidInput
            If there is no such quantity, or a value is not finite.
        """
        for key, value in values.items():
            if not math.isfinite(value):
                raise InvalidInput(f"{key}: {value} is not finite")
        data = {key: table for key, table in self.to_dict().items() if key != "design"}
        for key in values:
            try:
                own_value(data, key)
            except ValueError as error:
                raise InvalidInput(f"{key}: {error}") from None
        return Cell.load(changed(data, values))

    def save(self, path: str | Path, *, folder: Path | None = None) -> None:
        """Write the cell as TOML, with every default filled in; files that it names are named from its folder.

        ``folder`` is where the file will stand in the end, if not where it is written.
        """
        import tomli_w

        data, folder = self.to_dict(), (Path(path).parent if folder is None else folder).resolve()
        for table, key in (("arm", "urdf"), ("workpiece", "poses")):
            named = data[table].get(key)
            if named is not None and Path(named).is_absolute():
                data[table][key] = os.path.relpath(named, folder)
        with staged_file(path) as file:
            file.write_text(tomli_w.dumps(data), encoding="utf-8")

    # --- what it describes -----------------------------------------------------------------------

    def chain(self) -> SerialChain:
        """Return the arm."""
        return self.arm.chain()

    def home(self) -> NDArray[np.float64]:
        """Return the home configuration, (n,), m and rad."""
        import numpy as np

        joints = zip(self.arm.home, self.arm.joints, strict=True)
        return np.array([quantity(value, DIMENSION_OF_KIND[joint.type]) for value, joint in joints])

    def tool_path(self) -> ToolPath:
        """Return the raster over the workpiece, or the rows of its pose list."""
        if isinstance(self.workpiece, PoseList):
            return self._listed_path
        # frozen models have a hash; their base class has none in its types
        return _raster(self.workpiece, self.process)  # pyright: ignore[reportArgumentType]

    @cached_property
    def _listed_path(self) -> ToolPath:
        from qparm.surface import pose_list_tool_path

        assert isinstance(self.workpiece, PoseList)
        return pose_list_tool_path(
            self.workpiece.table,
            pose_base_workpiece=self.workpiece.pose.matrix(),
            self_motion_points=self.process.self_motion.points,
            turning_radius=self.workpiece.turning_radius,
        )

    def relaxation(self) -> Relaxation:
        """Return which rotations of the tool are free."""
        from qparm.path.relaxation import Relaxation

        return Relaxation(spin=self.process.tool_spin == "free", tilt=self.process.tool_tilt)

    def elasticity(self) -> Elasticity | None:
        """Return what deflects in the arm, None where the stiffness of a joint is not known."""
        import numpy as np

        from qparm.robot.compliance import Elasticity

        stiffness = self.arm.stiffness
        if stiffness is None or missing_stiffness(stiffness, self.arm.joints):
            return None
        joints = np.array([stiffness.of(joint) for joint in self.arm.joints], dtype=float)
        return Elasticity(joints, np.inf if stiffness.links is None else stiffness.links)

    def distance(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """Return the function that tells how far points (k, 3), base frame, are outside the workpiece (m), if known."""
        surface = self.workpiece.surface()
        if surface is None:
            return None
        T = self.workpiece.pose.matrix()
        return lambda points: surface.distance((points - T[:3, 3]) @ T[:3, :3])

    def jump(self) -> NDArray[np.float64]:
        """Return the joint steps beyond which neighbouring points are a jump, (n,), m and rad.

        A prismatic joint's, unless the cell gives it, is what it travels in the time in which the slowest
        revolute joint turns through the angle.
        """
        import numpy as np

        chain = self.chain()
        prismatic = self.process.jump_prismatic
        if prismatic is None:
            turning = chain.velocity[~chain.prismatic]
            seconds = self.process.jump / turning.min() if len(turning) else math.inf
            return np.where(chain.prismatic, chain.velocity * seconds, self.process.jump)
        return np.where(chain.prismatic, prismatic, self.process.jump)


# A study of thousands of arms has one raster.
@lru_cache(maxsize=8)
def _raster(workpiece: SphereZone, process: Process) -> ToolPath:
    from qparm.surface import serpentine_raster

    # a cell with a surface is valid with both only
    assert process.rows is not None
    assert process.points is not None
    made = serpentine_raster(
        workpiece.surface(),
        rows=process.rows,
        points=process.points,
        pose_base_workpiece=workpiece.pose.matrix(),
        stand_off=process.stand_off,
        self_motion_points=process.self_motion.points,
        transition=process.self_motion.transition,
        lift=process.self_motion.lift,
        row_end=process.self_motion.row_end,
        overrun=process.self_motion.overrun,
    )
    made.poses.flags.writeable = False  # it is shared
    return made


def _validated(data: dict[str, Any], source: str, folder: Path) -> Cell:
    try:
        cell = Cell.model_validate(data, context=_context(data, folder))
    except pydantic.ValidationError as error:
        raise CellError(source, [told(one, Cell) for one in error.errors(include_url=False)]) from None
    wrong = wrong_stiffness(cell.arm.stiffness, cell.arm.joints)
    if wrong:
        raise CellError(source, wrong)
    if isinstance(cell.workpiece, PoseList):
        try:
            table = cell.workpiece.table
        except InvalidInput as error:
            raise CellError(source, [("workpiece.poses", str(error))]) from None
        wrong = too_large(table)
        if wrong:
            raise CellError(source, [("workpiece.poses", wrong)])
    try:
        cell.tool_path()
    except InvalidInput as error:
        raise CellError(source, [("process", str(error))]) from None
    if isinstance(cell.workpiece, PoseList):
        wrong = _far_away(cell, cell.workpiece)
        if wrong:
            raise CellError(source, [("workpiece.poses", wrong)])
    if cell.design is not None:
        wrong = wrong_design(cell.to_dict(), cell.design) + _unknown_compliance(cell, cell.design)
        wrong = wrong or _wrong_at_bounds(cell, cell.design)
        if wrong:
            raise CellError(source, wrong)
    return cell


def _far_away(cell: Cell, workpiece: PoseList) -> str:
    """Return what is wrong with poses that lie as far away as if they were in another unit; empty if nothing is."""
    import numpy as np

    chain = cell.chain()
    links = (*(joint.transform_previous_joint for joint in chain.joints), chain.transform_tool)
    reach = sum(float(np.linalg.norm(T[:3, 3])) for T in links)
    reach += sum(max(map(abs, joint.position)) for joint in chain.joints if joint.kind == "prismatic")
    away = cell.tool_path().poses[:, :3, 3] - chain.transform_base[:3, 3]
    median = float(np.median(np.linalg.norm(away, axis=1)))
    if median <= _FAR * reach:
        return ""
    largest = float(np.abs(workpiece.table.poses[:, :3, 3]).max())
    guess = (
        "if it is in millimetres, name its columns x[mm],y[mm],z[mm]"
        if median <= _FAR * reach * 1e3 and largest > _FAR * reach
        else "are workpiece.pose and the list right?"
    )
    return (
        f"half of the poses lie {median:.4g} m and more from the arm's base, and the arm reaches no farther than"
        f" {reach:.3g} m; the list is read in metres: {guess}"
    )


def _wrong_at_bounds(cell: Cell, design: Design) -> list[tuple[str, str]]:
    """Return where the cell is not valid with a single variable at a bound: key path and sentence."""
    wrong = []
    for key, variable in design.variables.items():
        for written, value in zip(variable.range, variable.bounds, strict=True):
            try:
                cell.with_values({key: value})
            except CellError as error:
                where, sentence = error.problems[0]
                wrong.append(
                    (f'design.variables."{key}".range', f"at {written} the cell is not valid: {where}: {sentence}")
                )
    return wrong


def _unknown_compliance(cell: Cell, design: Design) -> list[tuple[str, str]]:
    """Return what a cell that asks for the compliance lacks: key path and sentence."""
    missing = missing_stiffness(cell.arm.stiffness, cell.arm.joints)
    asking = [key for key in ("objectives", "limits") if "compliance" in getattr(design, key)]
    return [(f"design.{key}", f"compliance: {missing}") for key in asking if missing]


def _context(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return what validators of single keys need to know of others that may be invalid themselves."""
    arm, workpiece = data.get("arm"), data.get("workpiece")
    lengths, joints = (arm.get("lengths"), arm.get("joints")) if isinstance(arm, Mapping) else (None, None)
    tables = [joint if isinstance(joint, Mapping) else {} for joint in joints] if isinstance(joints, list) else None
    return {
        "lengths": tuple(filter(lambda key: isinstance(key, str), lengths)) if isinstance(lengths, Mapping) else (),
        "joints": None if tables is None else [(table.get("name"), table.get("type"), None) for table in tables],
        "pose list": isinstance(workpiece, Mapping) and workpiece.get("shape") == "pose list",
        "folder": folder,
    }
