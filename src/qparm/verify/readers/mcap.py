"""A motion as the one JointTrajectory in an MCAP file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.files.reading import DATA_BYTES, guarded, read_bytes
from qparm.verify.readers.joint_trajectory import MESSAGE_TYPE, only_message, read_message

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_mcap"]


def read_mcap(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in an MCAP file, on whatever topic."""
    reader = load_extra("mcap.reader", instead="a file of the format json")
    decoder = load_extra("mcap_ros2.decoder", instead="a file of the format json")
    data = read_bytes(file)
    # what the libraries raise on a broken file is of many kinds
    with guarded(file, what="a whole MCAP file", foreign=True):
        _bound_chunks(file, data)
        opened = reader.make_reader(io.BytesIO(data), validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        messages = [
            (channel.topic, message)
            for schema, channel, _, message in opened.iter_decoded_messages()
            if schema is not None and schema.name == MESSAGE_TYPE and channel is not None
        ]
    return read_message(file, cell, only_message(file, messages), format="mcap")


def _bound_chunks(file: Path, data: bytes) -> None:
    """Refuse a file whose chunks unpack to more than is read, by what they say of themselves."""
    stream = load_extra("mcap.stream_reader", instead="a file of the format json")
    left = DATA_BYTES
    for record in stream.StreamReader(io.BytesIO(data), emit_chunks=True).records:
        if type(record).__name__ != "Chunk":
            continue
        size = record.uncompressed_size
        if record.compression == "zstd":
            zstandard = load_extra("zstandard", instead="a file of the format json")
            size = max(size, zstandard.frame_content_size(record.data))
        elif record.compression == "lz4":
            frame = load_extra("lz4.frame", instead="a file of the format json")
            size = max(size, frame.get_frame_info(record.data)["content_size"])
        left -= size
        if left < 0:
            raise InvalidInput(f"{file.name} has chunks that unpack to more than {DATA_BYTES / 2**20:.0f} MiB")
