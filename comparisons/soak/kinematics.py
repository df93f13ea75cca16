"""Kinematics and the zone of a sphere, written from ``docs/cell.md`` alone; nothing of qparm is imported."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Cell", "rpy_of"]

UNIT = {
    "m": 1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "in": 0.0254,
    "deg": np.pi / 180,
    "rad": 1,
    "mrad": 1e-3,
    "urad": 1e-6,
    "s": 1,
    "ms": 1e-3,
    "min": 60,
}


def si(text: str) -> float:
    """Return a quantity with its unit in SI."""
    match = re.fullmatch(r"\s*([-+0-9.eE]+)\s*(\S+)\s*", text)
    assert match is not None, text
    number, unit = match.groups()
    return float(number) * UNIT[unit.split("/")[0]]


def rx(a: float) -> NDArray[np.float64]:
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def ry(a: float) -> NDArray[np.float64]:
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def rz(a: float) -> NDArray[np.float64]:
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def frame(table: dict[str, Any] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    p, r = np.zeros(3), np.eye(3)
    if table:
        p = np.array([si(x) for x in table.get("position", ["0 m"] * 3)])
        a, b, c = [si(x) for x in table.get("rpy", ["0 rad"] * 3)]
        r = rz(c) @ ry(b) @ rx(a)
    return p, r


def rpy_of(r: NDArray[np.float64]) -> tuple[float, float, float]:
    return np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(np.clip(r[2, 0], -1, 1)), np.arctan2(r[1, 0], r[0, 0])


class Cell:
    """A cell file as the judge reads it: the arm, the zone of a sphere, the process."""

    def __init__(self, source: dict[str, Any] | str | Path) -> None:
        c = source if isinstance(source, dict) else tomllib.loads(Path(source).read_text(encoding="utf-8"))
        self.raw = c
        arm, work, proc = c["arm"], c["workpiece"], c["process"]
        lengths = {k: si(v) for k, v in arm.get("lengths", {}).items()}

        def value(x):
            return lengths[x] if x in lengths else si(x)

        self.names = [j["name"] for j in arm["joints"]]
        self.dh = np.array([[value(j["dh"][k]) for k in ("alpha", "a", "d", "theta")] for j in arm["joints"]])
        self.prismatic = np.array([j["type"] == "prismatic" for j in arm["joints"]])
        self.limits = np.array([[si(x) for x in j["position"]] for j in arm["joints"]])
        self.vmax, self.amax, self.jmax = (
            np.array([si(j[k]) for j in arm["joints"]]) for k in ("velocity", "acceleration", "jerk")
        )
        self.home = np.array([si(x) for x in arm["home"]])
        self.base, self.tool = frame(arm.get("base")), frame(arm.get("tool"))
        self.radius = si(work["radius"])
        self.elevation, self.azimuth = ([si(x) for x in work[k]] for k in ("elevation", "azimuth"))
        self.wp, self.wr = frame(work["pose"])
        self.rows, self.points = proc["rows"], proc["points"]

        def get(k, d):
            return si(proc.get(k, d))

        self.feed, self.stand_off, self.clearance = (
            get("feed", "0 m"),
            get("stand_off", "0 m"),
            get("clearance", "0.02 m"),
        )
        self.ptol, self.rtol = get("position_tolerance", "1 um"), get("rotation_tolerance", "10 urad")
        self.pbet, self.rbet = get("position_between", "5 um"), get("rotation_between", "20 urad")
        self.spin, self.tilt = proc.get("tool_spin", "fixed"), get("tool_tilt", "0 rad")
        self.jump = get("jump", "50 deg")
        slowest = self.vmax[~self.prismatic].min()
        self.jumps = np.where(self.prismatic, self.vmax * self.jump / slowest, self.jump)
        if "jump_prismatic" in proc:
            self.jumps[self.prismatic] = si(proc["jump_prismatic"])
        sm = proc.get("self_motion", {})
        self.transition, self.lift = sm.get("transition", "follow"), si(sm.get("lift", "0 m"))
        self.row_end, self.overrun = sm.get("row_end", "stop"), si(sm.get("overrun", "0.01 m"))
        self.els = np.linspace(*self.elevation, self.rows)
        self.azs = np.linspace(*self.azimuth, self.points)
        self.r = self.radius + self.stand_off

    def fk(self, q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (N, 3) and rotations (N, 3, 3) of the tool, modified Denavit-Hartenberg."""
        q = np.atleast_2d(q)
        p = np.tile(self.base[0], (len(q), 1))
        r = np.tile(self.base[1], (len(q), 1, 1))
        for i, (alpha, a, d, theta) in enumerate(self.dh):
            th = theta + (0 if self.prismatic[i] else q[:, i])
            dd = d + (q[:, i] if self.prismatic[i] else 0) + np.zeros(len(q))
            p = p + a * r[:, :, 0]
            r = r @ rx(alpha)
            p = p + dd[:, None] * r[:, :, 2]
            c, s = np.cos(th) + np.zeros(len(q)), np.sin(th) + np.zeros(len(q))
            x, y = r[:, :, 0].copy(), r[:, :, 1].copy()
            r = np.stack([c[:, None] * x + s[:, None] * y, -s[:, None] * x + c[:, None] * y, r[:, :, 2]], axis=2)
        return p + r @ self.tool[0], r @ self.tool[1]

    def nominal_local(self, az, el):
        """Return positions and rotations of the tool on the zone, in the workpiece's frame."""
        az, el = np.broadcast_arrays(np.asarray(az, float), np.asarray(el, float))
        n = np.stack([np.cos(el) * np.sin(az), -np.cos(el) * np.cos(az), np.sin(el)], -1)
        x = np.stack([np.cos(az), np.sin(az), np.zeros_like(az)], -1)
        return self.r * n, np.stack([x, np.cross(-n, x), -n], -1)

    def nominal(self, az, el):
        """Return positions and rotations of the tool on the zone, in the base frame."""
        p, r = self.nominal_local(az, el)
        return p @ self.wr.T + self.wp, self.wr @ r

    def point(self, index: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return azimuth and elevation of points of the raster by index: rows run back and forth."""
        row, k = index // self.points, index % self.points
        return np.where(row % 2 == 0, self.azs[k], self.azs[self.points - 1 - k]), self.els[row]

    def local(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points in the workpiece's frame."""
        return (p - self.wp) @ self.wr

    def angle_off(self, actual: NDArray[np.float64], nominal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far a tool is turned off (rad), the free spin and tilt of the cell taken out."""
        rel = np.swapaxes(nominal, -1, -2) @ actual
        z = rel[..., :, 2]
        lean = np.arctan2(np.hypot(z[..., 0], z[..., 1]), z[..., 2])
        outside = np.maximum(0, lean - self.tilt)
        if self.spin == "free":
            return outside
        # turn left after the shortest rotation that leads nominal z to actual z
        c, s = np.cos(lean), np.sin(lean)
        h = np.hypot(z[..., 0], z[..., 1])
        safe = np.where(h > 1e-12, h, 1)
        kx, ky = -z[..., 1] / safe, z[..., 0] / safe
        k = np.zeros(rel.shape)
        k[..., 0, 2], k[..., 1, 2], k[..., 2, 0], k[..., 2, 1] = ky, -kx, -ky, kx
        m = np.eye(3) + s[..., None, None] * k + (1 - c)[..., None, None] * (k @ k)
        rest = np.swapaxes(m, -1, -2) @ rel
        spin = np.abs(np.arctan2(rest[..., 1, 0] - rest[..., 0, 1], rest[..., 0, 0] + rest[..., 1, 1]))
        if self.tilt == 0:
            w = (
                np.stack(
                    [rel[..., 2, 1] - rel[..., 1, 2], rel[..., 0, 2] - rel[..., 2, 0], rel[..., 1, 0] - rel[..., 0, 1]],
                    -1,
                )
                / 2
            )
            return np.arctan2(np.linalg.norm(w, axis=-1), (np.trace(rel, axis1=-2, axis2=-1) - 1) / 2)
        return np.maximum(outside, spin)

    def jacobian(self, q):
        """Frames by the table, and the geometric Jacobian (N, 6, n) of the tool."""
        q = np.atleast_2d(q)
        n = len(q)
        p, r = np.tile(self.base[0], (n, 1)), np.tile(self.base[1], (n, 1, 1))
        axes, origins = [], []
        for i, (alpha, a, d, theta) in enumerate(self.dh):
            th = theta + (0 if self.prismatic[i] else q[:, i]) + np.zeros(n)
            dd = d + (q[:, i] if self.prismatic[i] else 0) + np.zeros(n)
            p = p + a * r[:, :, 0]
            r = r @ rx(alpha)
            p = p + dd[:, None] * r[:, :, 2]
            c, s = np.cos(th), np.sin(th)
            x, y, z = r[:, :, 0].copy(), r[:, :, 1].copy(), r[:, :, 2].copy()
            axes.append(z)
            origins.append(p)
            r = np.stack([c[:, None] * x + s[:, None] * y, -s[:, None] * x + c[:, None] * y, z], axis=2)
        p, r = p + r @ self.tool[0], r @ self.tool[1]
        jac = np.zeros((n, 6, len(self.dh)))
        for i in range(len(self.dh)):
            if self.prismatic[i]:
                jac[:, :3, i] = axes[i]
            else:
                jac[:, :3, i], jac[:, 3:, i] = np.cross(axes[i], p - origins[i]), axes[i]
        return p, r, jac

    def ik(self, p0, r0, rng, starts=30, iterations=120, q=None, every=False):
        """Damped least squares within limits from many starts at once: the least pose error (scaled) and its joints."""
        lo, hi = self.limits.T
        q = lo + (hi - lo) * rng.uniform(0.02, 0.98, (starts, len(lo))) if q is None else q
        starts = len(q)
        lam = np.full(starts, 1e-2)
        w8 = np.where(self.prismatic, 0.4, 1.0)

        def errors(q):
            p, r, jac = self.jacobian(q)
            rel = r0.T @ r
            w = (
                np.stack([rel[:, 2, 1] - rel[:, 1, 2], rel[:, 0, 2] - rel[:, 2, 0], rel[:, 1, 0] - rel[:, 0, 1]], -1)
                / 2
            )
            tr = (np.trace(rel, axis1=1, axis2=2) - 1) / 2
            nn = np.linalg.norm(w, axis=1)
            f = np.where(nn > 1e-9, np.arctan2(nn, tr) / np.maximum(nn, 1e-12), 1)
            w = w * f[:, None]
            if self.spin == "free":
                w[:, 2] = 0
            if self.tilt > 0:
                lean = np.hypot(w[:, 0], w[:, 1])
                w[:, :2] *= (np.maximum(0, lean - self.tilt) / np.maximum(lean, 1e-12))[:, None]
            e = np.concatenate([(p - p0) / 0.4, w], 1)
            j = np.concatenate([jac[:, :3] / 0.4, r0.T @ jac[:, 3:]], 1)
            if self.spin == "free":
                j[:, 5] = 0
            if self.tilt > 0:
                j[:, 3:5] *= (np.hypot(w[:, 0], w[:, 1]) > 0)[:, None, None]
            return e, j * w8

        e, j = errors(q)
        cost = np.linalg.norm(e, axis=1)
        for _ in range(iterations):
            g = np.einsum("nij,ni->nj", j, e)
            blocked = ((q <= lo + 1e-12) & (g > 0)) | ((q >= hi - 1e-12) & (g < 0))
            jj = np.where(blocked[:, None, :], 0, j)
            a = (
                jj @ np.swapaxes(jj, 1, 2)
                + (lam * np.maximum(cost, 1e-8))[:, None, None] * np.eye(6)
                + 1e-13 * np.eye(6)
            )
            d = -np.einsum("nij,ni->nj", jj, np.linalg.solve(a, e[..., None])[..., 0])
            size = np.abs(d).max(1)
            d *= np.minimum(1, 0.5 / np.maximum(size, 1e-12))[:, None]
            qn = np.clip(q + d * w8, lo, hi)
            en, jn = errors(qn)
            cn = np.linalg.norm(en, axis=1)
            ok = cn < cost
            q, e, j, cost = (
                np.where(ok[:, None], qn, q),
                np.where(ok[:, None], en, e),
                np.where(ok[:, None, None], jn, j),
                np.where(ok, cn, cost),
            )
            lam = np.clip(np.where(ok, lam / 3, lam * 4), 1e-9, 1e4)
            if (cost.max() if every else cost.min()) < 1e-10:
                break
        if every:
            return cost, q
        k = cost.argmin()
        return cost[k], q[k]
