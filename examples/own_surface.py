"""A surface of your own: a column, 0.6 m in radius and 0.3 m high, planned with the library's stages."""

from dataclasses import replace

import numpy as np

import qparm
from qparm.planning import assemble, graph, problem_of, smooth_found
from qparm.surface import serpentine_raster
from qparm.timing import quintic_trajectory


class Column:  # noqa: D101
    # u runs around it, v up, both from 0 to 1; outward normals, unit tangents along u
    row_length = staticmethod(lambda v: 0.6 * np.radians(80))
    column_length = staticmethod(lambda v0, v1: 0.3 * abs(v1 - v0))
    angle = staticmethod(lambda u, v: np.radians(80) * (np.asarray(u) - 0.5) + 0.0 * np.asarray(v))
    normal = staticmethod(lambda u, v: np.stack([np.sin(a := Column.angle(u, v)), -np.cos(a), 0 * a], axis=-1))
    along = staticmethod(lambda u, v: np.stack([np.cos(a := Column.angle(u, v)), np.sin(a), 0 * a], axis=-1))
    point = staticmethod(lambda u, v: 0.6 * Column.normal(u, v) + 0.3 * np.asarray(v)[..., None] * [0, 0, 1])


cell = qparm.Cell.load("examples/dome.toml")
path = serpentine_raster(Column(), rows=4, points=31, pose_base_workpiece=cell.workpiece.pose.matrix())
problem = replace(problem_of(cell), tool_path=path, distance=None)
solution, _ = smooth_found(problem, graph(problem)[0])
joint_path, breaks = assemble(problem, solution)
print(joint_path, quintic_trajectory(problem.chain, joint_path, feed=problem.feed), sep="\n")
