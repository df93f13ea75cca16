"""The tree of links and joints of a URDF, as it is written: what stands between two links, in order."""

from __future__ import annotations

import difflib
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from qparm.errors import InvalidInput

__all__ = ["JointElement", "joints_between", "urdf_text"]

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
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != len(default):
            count = "a number" if len(default) == 1 else f"{len(default)} numbers"
            raise InvalidInput(f"joint {self.name!r}: {attribute} of its {tag} must be {count}, not {text[:60]!r}")
        if not all(map(math.isfinite, values)):
            raise InvalidInput(f"joint {self.name!r}: {attribute} of its {tag} is not finite: {text[:60]!r}")
        return values


class _NoDoctype(ET.TreeBuilder):
    """Builds the tree of a document that declares nothing: entities can neither grow nor reach for other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> NoReturn:
        """Refuse the declaration before its entities are read."""
        raise InvalidInput("the URDF has a DOCTYPE; a URDF needs none, and entities are not read")


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
        return Path(source).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InvalidInput(f"there is no URDF file {str(source)!r}") from None
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{str(source)!r} is not UTF-8 text: byte {error.start} cannot be read") from None
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{str(source)!r} cannot be read: {getattr(error, 'strerror', None) or error}") from None


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
    parser = ET.XMLParser(target=_NoDoctype())
    try:
        parser.feed(text)
        robot = parser.close()
    except ET.ParseError as error:
        raise InvalidInput(f"the URDF is not whole XML, it may be cut short: {error}") from None
    except ValueError as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"the URDF cannot be read as XML: {error}") from None
    if robot.tag != "robot":
        raise InvalidInput(f"the URDF's outermost element must be 'robot', not {robot.tag[:60]!r}")
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
