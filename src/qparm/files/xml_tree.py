"""XML as a tree, for files that only describe: nothing is declared in them, and nothing outside is read."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import NoReturn
from xml.parsers import expat

from qparm.errors import InvalidInput

__all__ = ["xml_tree"]


def xml_tree(text: str, *, what: str) -> ET.Element:
    """Return the outermost element of an XML text.

    Prefixes of names are part of them and need not be declared: tools write ``<limit drake:acceleration="2.5"/>``
    without saying where ``drake`` comes from.

    Parameters
    ----------
    text : str
    what : str
        Named in errors, such as ``"the URDF"``.

    Raises
    ------
    InvalidInput
        If it is not whole XML, or has a DOCTYPE: entities can grow without bound and reach for other files.
    """
    # without a separator expat knows no namespaces; the encoding is that of the text, whatever its first line says
    builder, parser = ET.TreeBuilder(), expat.ParserCreate("utf-8")
    parser.buffer_text = True

    def refuse(*_: object) -> NoReturn:
        raise InvalidInput(f"{what} has a DOCTYPE; it needs none, and entities are not read")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.encode("utf-8"), True)
        return builder.close()
    except expat.ExpatError as error:
        raise InvalidInput(f"{what} is not whole XML, it may be cut short: {error}") from None
    except (UnicodeError, AssertionError) as error:
        raise InvalidInput(f"{what} cannot be read as XML: {error}") from None
