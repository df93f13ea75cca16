"""The tree of links and joints of a URDF, as it is written: what stands between two links, in order."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.files.reading import TEXT_BYTES, MissingFile, number, read_text, shown
from qparm.files.xml_tree import xml_tree

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

__all__ = ["JointElement", "joints_between", "urdf_text"]

# No number of an arm is larger (m, rad, and per second).
_LARGEST = 1e9
# How elements begin that the tool xacro makes a URDF of.
_XACRO = "xacro:"
_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class JointElement:
    """A joint between base and tip, as the file has it.

    Attributes
    ----------
    name : str
    type : str
        ``"fixed"``, ``"revolute"``, ``"continuous"`` or ``"prismatic"``.
    element : xml.etree.ElementTree.Element
    """

    name: str
    type: str
    element: ET.Element

    def has(self, tag: str, attribute: str) -> bool:
        """Return whether a child element has an attribute."""
        child = self.element.find(tag)
        return child is not None and attribute in child.attrib

    def numbers(self, tag: str, attribute: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return the numbers of a child's attribute, the default where it is absent.

        Raises
        ------
        InvalidInput
            If they are not as many finite numbers as the default has.
        """
        if not self.has(tag, attribute):
            return default
        child = self.element.find(tag)
        text = "" if child is None else child.attrib[attribute]
        values = tuple(value for word in text.split() if (value := number(word)) is not None)
        if len(values) != len(default) or len(text.split()) != len(default):
            count = "a number" if len(default) == 1 else f"{len(default)} numbers"
            raise InvalidInput(f"joint {self.name!r}: {attribute} of its {tag} must be {count}, not {text[:60]!r}")
        if not all(map(math.isfinite, values)):
            raise InvalidInput(f"joint {self.name!r}: {attribute} of its {tag} is not finite: {text[:60]!r}")
        if max(map(abs, values)) > _LARGEST:
            raise InvalidInput(
                f"joint {self.name!r}: {attribute} of its {tag} has a number beyond {_LARGEST:g}: {text[:60]!r}"
            )
        return values


def urdf_text(source: str | Path) -> str:
    """Return a URDF's text: of a file, or what was given if it is the text itself.

    Raises
    ------
    InvalidInput
        If there is no such file or it is not UTF-8 text.
    """
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return source
    try:
        return read_text(source, largest=TEXT_BYTES, empty=True)
    except MissingFile:
        raise InvalidInput(f"there is no URDF file {str(source)!r}") from None


def joints_between(text: str, base: str, tip: str) -> tuple[str, tuple[JointElement, ...]]:
    """Return the robot's name and the joints from one link to another, fixed ones included.

    Parameters
    ----------
    text : str
        The URDF.
    base, tip : str

    Returns
    -------
    name : str
    joints : tuple of JointElement
        From base to tip.

    Raises
    ------
    InvalidInput
        With a sentence that names the joint or the link.
    """
    robot = _robot(text)
    links = [link.get("name", "") for link in robot.findall("link")]
    for link in (base, tip):
        if link not in links:
            near = difflib.get_close_matches(link, links, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"its links are {', '.join(links[:20]) or 'none'}"
            raise InvalidInput(f"the URDF has no link {link!r}; {hint}")
    parents = _joints_by_child(robot)
    found: list[JointElement] = []
    names: set[str] = set()
    link = tip
    while link != base:
        above = parents.get(link, [])
        if not above:
            raise InvalidInput(
                f"link {tip!r} does not hang on link {base!r}: the way from it to the root ends at {link!r}"
            )
        if len(above) > 1:
            both = " and ".join(repr(joint.get("name", "")) for joint in above[:2])
            raise InvalidInput(f"link {link!r} has two parents: joints {both}")
        joint = _usable(above[0])
        if joint.name in names:
            raise InvalidInput(f"joint {joint.name!r} comes twice above link {tip!r}: two have its name, or a ring")
        names.add(joint.name)
        found.append(joint)
        link = _end(above[0], "parent")
        if link not in links:
            raise InvalidInput(f"joint {joint.name!r} hangs on link {link!r}, which the URDF does not have")
    return robot.get("name", "").strip() or "arm", tuple(reversed(found))


def _robot(text: str) -> ET.Element:
    robot = xml_tree(text, what="the URDF")
    if robot.tag != "robot":
        raise InvalidInput(f"the URDF's outermost element must be 'robot', not {shown(robot.tag)!r}")
    if any(element.tag.startswith(_XACRO) for element in robot.iter()):
        raise InvalidInput(
            "the URDF is xacro, which is yet to be expanded: `xacro arm.urdf.xacro > arm.urdf`, and name that file"
        )
    return robot


def _joints_by_child(robot: ET.Element) -> dict[str, list[ET.Element]]:
    parents: dict[str, list[ET.Element]] = {}
    for joint in robot.findall("joint"):
        parents.setdefault(_end(joint, "child"), []).append(joint)
    return parents


def _end(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    link = None if element is None else element.get("link")
    if not link:
        raise InvalidInput(f"joint {joint.get('name', '')!r} has no {which} link")
    return link


def _usable(element: ET.Element) -> JointElement:
    name, kind = element.get("name", ""), element.get("type", "")
    if not name:
        raise InvalidInput(f"the joint of link {_end(element, 'child')!r} has no name")
    if kind not in ("fixed", *_MOVING):
        raise InvalidInput(
            f"joint {name!r} is of type {kind!r}; between base and tip it must be fixed, {', '.join(_MOVING)}"
        )
    if element.find("mimic") is not None and kind != "fixed":
        raise InvalidInput(f"joint {name!r} mimics another joint, which a serial chain cannot")
    return JointElement(name, kind, element)
