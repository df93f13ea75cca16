"""Planning: from the tool's path to a joint path. One file a strategy."""

from qparm.planning.general import PointRecord, TrackRecord, track

__all__ = ["PointRecord", "TrackRecord", "track"]
