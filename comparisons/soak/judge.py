"""The judge of written files: what a plan's folder holds, against the cell and the definitions alone."""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.soak.feed import Judge, judge_feed
from comparisons.soak.kinematics import Cell

__all__ = ["check"]


def hermite(h, p0, v0, a0, p1, v1, a1, x):
    """Quintics of intervals at shares x: position, velocity, acceleration, jerk, each (x, intervals, n)."""
    h = h[:, None]
    c0, c1, c2 = p0, v0 * h, a0 * h * h / 2
    d, dv, da = p1 - p0 - c1 - c2, (v1 - v0) * h - 2 * c2, (a1 - a0) * h * h
    c3, c4, c5 = 10 * d - 4 * dv + da / 2, -15 * d + 7 * dv - da, 6 * d - 3 * dv + da / 2
    x = x[:, None, None]
    return (
        c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))),
        (c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / h,
        (2 * c2 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))) / h**2,
        (6 * c3 + x * (24 * c4 + x * 60 * c5)) / h**3,
    )


def off_surface(judge, where, cell, kind, row, p, share=1e-9):
    x = cell.local(p)
    dist = np.linalg.norm(x, axis=1) - cell.radius
    f = judge.figures
    if kind == "transition":
        rest = dist - cell.stand_off
        judge.that(f"{where}: dip on transition {row}", -rest.min(), max(5e-6, cell.pbet))
        judge.that(
            f"{where}: height on transition {row}",
            rest.max(),
            (cell.lift if cell.transition == "lift" else 0) + max(5e-6, cell.pbet),
        )
        if cell.row_end == "stop":
            az = np.arctan2(x[:, 0], -x[:, 1])
            want = cell.azimuth[1] if row % 2 == 0 else cell.azimuth[0]
            side = np.abs((az - want + np.pi) % (2 * np.pi) - np.pi) * np.hypot(x[:, 0], x[:, 1])
            judge.that(f"{where}: off the meridian on transition {row}", side.max(), max(5e-6, cell.pbet) * 1.001)
        return
    f["least distance"] = min(f.get("least distance", np.inf), dist.min())
    judge.that(f"{where}: depth in {kind} {row}", -dist.min(), max(5e-6, cell.pbet))
    near = dist < cell.clearance - 1e-7
    if not (~near).any():
        judge.wrong.append(f"{where}: {kind} {row} never clear (least {dist.min():.4g}, most {dist.max():.4g})")
        return
    first, last = np.flatnonzero(~near)[[0, -1]]
    least = dist[first : last + 1].min()
    f["least clearance"] = min(f.get("least clearance", np.inf), least)
    judge.that(f"{where}: clearance missed in {kind} {row}", cell.clearance - least, 1e-6)
    up, down = np.diff(dist[: first + 1]), np.diff(dist[last:])
    if kind == "approach" and first > 0:
        judge.wrong.append(f"{where}: approach begins inside the clearance")
    if kind == "retract" and last < len(dist) - 1:
        judge.wrong.append(f"{where}: retract ends inside the clearance")
    judge.that(f"{where}: sinks while leaving in {kind} {row}", -up.min() if len(up) else 0, 1e-8)
    judge.that(f"{where}: rises while returning in {kind} {row}", down.max() if len(down) else 0, 1e-8)


def off_rows(segments):
    """Segments that are no rows; what follows each other is one way: a lift may be several straight lines."""
    found = []
    for one in segments:
        alike = found and (found[-1]["kind"], found[-1]["row"]) == (one["kind"], one["row"])
        if one["kind"] == "row":
            continue
        if alike and one["kind"] != "transition" and abs(found[-1]["end"] - one["start"]) < 1e-6:
            found[-1] = found[-1] | {"end": one["end"]}
        else:
            found.append(dict(one))
    return found


def on_rows(judge, where, cell, row, q, reached):
    """Tool on a stretch of a row: off the row's circle, turned, backwards, off at the points."""
    p, r = cell.fk(q)
    x = cell.local(p)
    el = cell.els[row]
    mid = np.mean(cell.azimuth)
    az = mid + (np.arctan2(x[:, 0], -x[:, 1]) - mid + np.pi) % (2 * np.pi) - np.pi
    p0, r0 = cell.nominal(az, el)
    off, turn = np.linalg.norm(p - p0, axis=1), cell.angle_off(r, r0)
    f = judge.figures
    judge.that(f"{where}: off row {row}", off.max(), cell.pbet * 1.0005 + 1e-9)
    judge.that(f"{where}: turned on row {row}", turn.max(), cell.rbet * 1.0005 + 1e-8)
    f["off row"], f["turn row"] = max(f.get("off row", 0), off.max()), max(f.get("turn row", 0), turn.max())
    f["off sphere"] = max(f.get("off sphere", 0), np.abs(np.linalg.norm(x, axis=1) - cell.r).max())
    way = (az - az[0]) * (1 if row % 2 == 0 else -1)
    judge.that(
        f"{where}: backwards on row {row}",
        -(np.diff(way).min() if len(way) > 1 else 0) * cell.r * np.cos(el),
        cell.pbet,
    )
    return az, off, turn


def check(cell_file: Path, out: Path, rc: int | None = None) -> dict[str, Any]:
    """Return what is wrong with a plan's files, what its report tells wrong, and figures.

    ``mine`` is whether they are valid by this judge, ``claimed`` whether the plan says so.
    """
    cell, out, judge = Cell(cell_file), Path(out), Judge()
    f, n = judge.figures, len(cell.names)
    report = json.loads((out / "report.json").read_text())
    # joint path
    table = list(csv.reader((out / "joint_path.csv").read_text(encoding="utf-8").splitlines()))
    if table[0][5:] != [f"{x}[{'m' if c else 'rad'}]" for x, c in zip(cell.names, cell.prismatic, strict=False)]:
        judge.wrong.append("joint_path.csv: columns")
    table = table[1:]
    index, row = (np.array([int(x[i]) for x in table]) for i in (0, 1))
    kind, _status = [x[2] for x in table], [x[3] for x in table]
    q = np.array([[float(v) for v in x[5:]] for x in table])
    over = np.maximum(cell.limits[:, 0] - q, q - cell.limits[:, 1]).max()
    judge.that("waypoint beyond position limits", over, 1e-9)
    judge.that("first waypoint from home", np.abs(q[0] - cell.home).max(), 1e-9)
    judge.that("last waypoint from home", np.abs(q[-1] - cell.home).max(), 1e-9)
    at = index >= 0
    reached = index[at]
    f["reached"], f["asked"] = len(set(reached.tolist())), cell.rows * cell.points
    if (np.diff(reached) <= 0).any():
        judge.wrong.append("indices not ascending")
    if len(reached):
        az, el = cell.point(reached)
        p, r = cell.fk(q[at])
        p0, r0 = cell.nominal(az, el)
        off, turn = np.linalg.norm(p - p0, axis=1), cell.angle_off(r, r0)
        judge.that("points: position error", off.max(), cell.ptol * (1 + 1e-6))
        judge.that("points: rotation error", turn.max(), cell.rtol * (1 + 1e-6) + 2e-11)
    # steps: between neighbouring points in the same row with nothing but row waypoints between
    where = np.flatnonzero(at)
    jumps, breaks, step = [], 0, np.zeros(n)
    for a, b in itertools.pairwise(where):
        if row[a] != row[b]:
            continue
        d = np.abs(q[b] - q[a])
        if any(k in ("break",) for k in kind[a + 1 : b + 1]):
            breaks += 1
            continue
        if index[b] != index[a] + 1:
            judge.wrong.append(f"points {index[a]} to {index[b]}: a gap without a motion")
            continue
        step = np.maximum(step, d)
        if (d > cell.jumps * (1 + 1e-9)).any():
            jumps.append((int(index[a]), int(index[b])))
    f["jumps"], f["breaks inside rows"], f["largest steps"] = len(jumps), breaks, step.tolist()
    rs = np.array([j["largest_step"] for j in report["joints"]])
    f["largest steps as reported"] = rs.tolist()
    # samples
    text = (out / "trajectory.csv").read_text().splitlines()
    head = text[0].split(",")
    want = ["t[s]"]
    for order, pre in enumerate(("q_", "qd_", "qdd_", "qddd_")):
        want += [
            f"{pre}{x}[{'m' if c else 'rad'}{['', '/s', '/s^2', '/s^3'][order]}]"
            for x, c in zip(cell.names, cell.prismatic, strict=False)
        ]
    if head != [*want, "row", "segment", "process_on"]:
        judge.wrong.append("trajectory.csv: columns")
    parts = [x.rsplit(",", 3) for x in text[1:]]
    seg, srow, on = (
        np.array([x[2] for x in parts]),
        np.array([int(x[1]) for x in parts]),
        np.array([x[3] == "1" for x in parts]),
    )
    data = np.array([np.fromstring(x[0], sep=",") for x in parts])
    t, s = data[:, 0], [data[:, 1 + k * n : 1 + (k + 1) * n] for k in range(4)]
    if len(t) < 2:
        f["duration"] = 0.0
        told = [] if not report["executable"] and f["reached"] == 0 else ["an empty motion"]
        return {
            "claimed": report["executable"],
            "mine": False,
            "wrong": judge.wrong,
            "told wrong": told,
            "reasons": report["reasons"],
            "figures": f,
        }
    h = t[1] - t[0]
    f["samples"], f["duration"] = len(t), t[-1]
    judge.that("times: not a grid", np.abs(np.diff(t[:-1]) - h).max() if len(t) > 2 else 0, 1e-6 * h + 1e-11 * t[-1])
    judge.that("process_on is not row", np.sum(on != (seg == "row")), 0)
    judge.that(
        "samples beyond position limits", np.maximum(cell.limits[:, 0] - s[0], s[0] - cell.limits[:, 1]).max(), 2e-9
    )
    for k, lim, name in ((1, cell.vmax, "velocity"), (2, cell.amax, "acceleration"), (3, cell.jmax, "jerk")):
        judge.that(f"samples: {name} share", (np.abs(s[k]) / lim).max(), 1 + 2e-6)
        worst, _d0 = 0.0, s[0]
        for stride in (1, 2, 4, 8, 16, 32):
            x = s[0][:-1][::1]
            d = x
            for _ in range(k):
                d = d[stride:] - d[:-stride]
                if len(d) == 0:
                    break
            if len(d):
                noise = 2**k * 0.5e-11 * 10 ** np.floor(np.log10(np.maximum(np.abs(s[0]).max(0), 1e-3)))
                worst = max(worst, ((np.abs(d) - noise) / (h * stride) ** k / lim).max())
        judge.that(f"divided differences: {name} share", worst, 1 + 1e-5)
    hh = np.diff(t)[:, None]
    ok = hh[:, 0] > 1e-6
    r1 = s[0][1:] - s[0][:-1] - hh / 2 * (s[1][1:] + s[1][:-1]) + hh**2 / 12 * (s[2][1:] - s[2][:-1])
    judge.that(
        "columns: positions against velocities",
        (np.abs(r1) / (hh**3 * cell.jmax * 0.0325 + 1e-11 * (1 + np.abs(s[0][1:])))).max(),
        1,
    )
    r2 = s[1][1:] - s[1][:-1] - hh / 2 * (s[2][1:] + s[2][:-1])
    judge.that("columns: velocities against accelerations", (np.abs(r2) / (hh**2 * cell.jmax * 0.25 + 1e-10)).max(), 1)
    r3 = s[2][1:] - s[2][:-1]
    judge.that(
        "columns: accelerations against the jerk limit", (np.abs(r3) / (hh * cell.jmax * 1.00001 + 1e-9)).max(), 1
    )
    odd = np.abs(r3 - hh / 2 * (s[3][1:] + s[3][:-1])) > hh * cell.jmax * 0.05 + 1e-9
    f["columns: share of intervals whose jerk says otherwise"] = float(odd[ok].mean())
    for name, i in (("start", 0), ("end", -1)):
        judge.that(f"{name}: from home", np.abs(s[0][i] - cell.home).max(), 1e-8)
        judge.that(f"{name}: speed", np.abs(s[1][i]).max(), 1e-7)
        judge.that(f"{name}: acceleration", np.abs(s[2][i] / cell.amax).max(), 1e-4)
    # the tool at the samples, feed
    spans = [(np.searchsorted(t, x["start"] + 1e-9), np.searchsorted(t, x["end"] - 1e-9)) for x in report["segments"]]
    for x, (a, b) in zip(report["segments"], spans, strict=True):
        if b <= a:
            continue
        if (seg[a:b] != x["kind"]).any() or (srow[a:b] != x["row"]).any():
            called = f"{set(seg[a:b].tolist())} {set(srow[a:b].tolist())}"
            judge.wrong.append(f"samples {a} to {b}: called {called}, the report says {x['kind']} {x['row']}")
        if seg[a] == "row":
            az, _, _ = on_rows(judge, "samples", cell, srow[a], s[0][a:b], reached)
            judge_feed(judge, cell, report, int(srow[a]), t[a:b], [part[a:b] for part in s], az)
    for x in off_rows(report["segments"]):
        a, b = np.searchsorted(t, x["start"] + 1e-9), np.searchsorted(t, x["end"] - 1e-9)
        if b > a:
            off_surface(judge, "samples", cell, x["kind"], x["row"], cell.fk(s[0][a:b])[0])
    # trajectory.json, as a controller passes it
    js = json.loads((out / "trajectory.json").read_text())
    f["json executable key"] = js.get("executable", "absent")
    js = js.get("joint_trajectory", js)
    pts = js["points"]
    if js["joint_names"] != cell.names:
        judge.wrong.append("trajectory.json: joint names")
    jt = np.array([x["time_from_start"]["sec"] + 1e-9 * x["time_from_start"]["nanosec"] for x in pts])
    P, V, A = (np.array([x[k] for x in pts], float) for k in ("positions", "velocities", "accelerations"))
    dt = np.diff(jt)
    if (dt <= 0).any():
        judge.wrong.append("trajectory.json: times not growing")
    judge.that("json: duration against csv", abs(jt[-1] - t[-1]), 1e-6)
    args = (dt, P[:-1], V[:-1], A[:-1], P[1:], V[1:], A[1:])
    peaks = [0.0, 0.0, 0.0]
    posover = -np.inf
    for x in np.linspace(0, 1, 25):
        z = hermite(*args, np.array([x]))
        posover = max(posover, np.maximum(cell.limits[:, 0] - z[0], z[0] - cell.limits[:, 1]).max())
        for k, lim in ((1, cell.vmax), (2, cell.amax), (3, cell.jmax)):
            y = np.abs(z[k][0]) / lim
            if k == 3:
                y = y[dt >= 1e-4]
            peaks[k - 1] = max(peaks[k - 1], y.max() if y.size else 0)
    judge.that("json: beyond position limits", posover, 2e-9)
    for name, v, tol in zip(("velocity", "acceleration", "jerk"), peaks, (2e-6, 1e-5, 2e-3), strict=False):
        judge.that(f"json: {name} share between points", v, 1 + tol)
    places = np.linspace(0, 1, 9)[:-1]
    dense = np.concatenate([np.swapaxes(hermite(*args, places)[0], 0, 1).reshape(-1, n), P[-1:]])
    tt = np.r_[(jt[:-1, None] + dt[:, None] * places).ravel(), jt[-1]]
    crossing_p = crossing_r = 0.0
    seen = set()
    for sg in report["segments"]:
        a, b = np.searchsorted(tt, sg["start"] - 1e-9), np.searchsorted(tt, sg["end"] + 1e-9)
        if b - a < 2:
            continue
        if sg["kind"] == "row":
            az, off, turn = on_rows(judge, "json", cell, sg["row"], dense[a:b], reached)
            o = np.argsort(az, kind="stable")
            mine = [
                i
                for i in reached.tolist()
                if i // cell.points == sg["row"] and az[o[0]] - 1e-7 <= cell.point(np.array(i))[0] <= az[o[-1]] + 1e-7
            ]
            seen.update(mine)
            if mine:
                pa = cell.point(np.array(mine))[0]
                crossing_p = max(crossing_p, np.interp(pa, az[o], off[o]).max())
                crossing_r = max(crossing_r, np.interp(pa, az[o], turn[o]).max())
    for x in off_rows(report["segments"]):
        a, b = np.searchsorted(tt, x["start"] - 1e-9), np.searchsorted(tt, x["end"] + 1e-9)
        if b - a >= 2:
            off_surface(judge, "json", cell, x["kind"], x["row"], cell.fk(dense[a:b])[0])
    judge.that("json: off at points", crossing_p, cell.ptol * 1.001 + 1e-9)
    judge.that("json: turned at points", crossing_r, cell.rtol * 1.001 + 2e-9)
    alone = {i for i in reached.tolist() if i not in seen}
    alone = {i for i in alone if np.abs(P - q[at][reached.tolist().index(i)]).max(1).min() > 1e-6}
    if alone:
        judge.wrong.append(f"json: {len(alone)} points not passed, such as {sorted(alone)[:3]}")
    # what the report says
    m = report["measured"]
    told = []
    if f["reached"] != m["reached"]:
        told.append(f"reached {m['reached']}, here {f['reached']}")
    if abs(m["duration"] - t[-1]) > 1e-6:
        told.append(f"duration {m['duration']}, here {t[-1]}")
    if m["points"] != f["asked"]:
        told.append("points")
    if len(m["jumps"]) != len(jumps):
        told.append(f"jumps {len(m['jumps'])}, here {len(jumps)}")
    if np.abs(rs - step).max() > 1e-9:
        told.append(f"largest steps {np.round(rs, 5).tolist()}, here {np.round(step, 5).tolist()}")
    if len(report["unreached"]) != f["asked"] - f["reached"]:
        told.append(f"unreached {len(report['unreached'])}, here {f['asked'] - f['reached']}")
    if rc is not None and (rc == 0) != report["executable"]:
        told.append(f"exit code {rc}, executable {report['executable']}")
    if (js.get("executable", True) and f["json executable key"] != False) != report["executable"]:  # noqa: E712
        told.append(f"trajectory.json executable {f['json executable key']}")
    for k, name in ((0, "velocity"), (1, "acceleration"), (2, "jerk")):
        claim = max(j[name + "_share"] for j in report["joints"])
        if claim < peaks[k] * (1 - 1e-3) - 1e-3:
            told.append(f"{name} share {claim:.6g}, here {peaks[k]:.6g}")
    mine_valid = f["reached"] == f["asked"] and not judge.wrong
    return {
        "claimed": report["executable"],
        "mine": mine_valid,
        "wrong": judge.wrong,
        "told wrong": told,
        "reasons": report["reasons"],
        "figures": f,
    }
