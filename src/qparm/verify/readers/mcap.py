"""A motion as the one JointTrajectory in an MCAP file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.verify.readers.joint_trajectory import MESSAGE_TYPE, only_message, read_message
from qparm.verify.readers.table import read_bytes

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_mcap"]


def read_mcap(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in an MCAP file, on whatever topic."""
    reader = load_extra("mcap.reader", instead="a file of the format json")
    decoder = load_extra("mcap_ros2.decoder", instead="a file of the format json")
    data = read_bytes(file)
    try:
        opened = reader.make_reader(io.BytesIO(data), validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        messages = [
            (channel.topic, message)
            for schema, channel, _, message in opened.iter_decoded_messages()
            if schema is not None and schema.name == MESSAGE_TYPE and channel is not None
        ]
    except Exception as error:  # what the library raises on a broken file is of many kinds
        raise InvalidInput(f"{file.name} is not a whole MCAP file: {type(error).__name__} {error}") from None
    return read_message(file, cell, only_message(file, messages), format="mcap")
