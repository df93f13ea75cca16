"""Random cells, seeded by their number: near the reference cell, placed within reach, or anything."""

from __future__ import annotations

from typing import Any

import numpy as np

from comparisons.soak.kinematics import Cell, rpy_of

__all__ = ["generate", "toml"]


def lu(rng: np.random.Generator, a: float, b: float) -> float:
    """Return a number between a and b whose logarithm is evenly distributed."""
    return float(np.exp(rng.uniform(np.log(a), np.log(b))))


def generate(k: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return cell k as plain data, and the options with which it is planned."""
    rng = np.random.default_rng([20261201, k])
    u, pick = rng.uniform, rng.random
    mode = rng.choice(["near", "placed", "placed", "placed", "wild"])
    name = f"soak-{k}-{mode}"
    if mode == "near":
        lengths = [480 * u(0.85, 1.2), 400 * u(0.85, 1.2), 418 * u(0.85, 1.2), 120 * u(0.7, 1.4)]
    elif mode == "placed":
        lengths = [u(250, 700), u(200, 600), u(200, 600), u(40, 250)]
    else:
        lengths = [lu(rng, 80, 1200) for _ in range(4)]
    lengths = [round(float(x), 1) for x in lengths]
    table = [
        (-90, 0, 0, -90),
        (180, "L1", 0, 0),
        (90, 0, 0, 90),
        (90, 0, "L2", 0),
        (-90, 0, 0, 0),
        (90, 0, "L3", 0),
        (-90, 0, 0, 0),
        (90, 0, "L4", 90),
    ]
    offsets = pick() < 0.15
    limits, standard = [], [170, 120, 170, 120, 170, 120, 175]
    low = 0.0 if mode == "near" else round(float(u(-500, 200)))
    limits.append((low, low + (round(float(u(500, 1200))) if mode == "near" else round(lu(rng, 60, 2000)))))
    for s in standard:
        if mode == "near":
            w = s * u(0.75, 1.0)
            limits.append((-round(w, 1), round(s * u(0.75, 1.0), 1)))
        elif pick() < (0.2 if mode == "placed" else 0.35):
            c, w = u(-s * 0.7, s * 0.7), u(30, 110)
            limits.append((round(max(c - w / 2, -179), 1), round(min(c + w / 2, 179), 1)))
        else:
            limits.append((-round(u(60, s + 4), 1), round(u(60, s + 4), 1)))
    v = [lu(rng, 30, 1000)] + [lu(rng, 10, 200) for _ in range(7)]
    if mode == "near":
        v = [200 * u(0.5, 1.5)] + [60 * u(0.5, 1.5) for _ in range(7)]
    a = [x * lu(rng, 1, 20) for x in v]
    j = [x * lu(rng, 3, 50) for x in a]
    joints, names = [], ["d1"] + [f"theta{i}" for i in range(2, 9)]
    for i in range(8):
        al, aa, dd, th = table[i]
        if offsets and i > 0:
            aa = aa if isinstance(aa, str) else round(float(u(-40, 40)), 1)
            dd = dd if isinstance(dd, str) else round(float(u(-40, 40)), 1)
        len_unit, ang = "mm", "deg"
        unit = len_unit if i == 0 else ang

        def q(x):
            return x if isinstance(x, str) else f"{x} mm"

        joints.append(
            {
                "name": names[i],
                "type": "prismatic" if i == 0 else "revolute",
                "dh": {"alpha": f"{al} deg", "a": q(aa), "d": q(dd), "theta": f"{th} deg"},
                "position": [f"{limits[i][0]} {unit}", f"{limits[i][1]} {unit}"],
                "velocity": f"{v[i]:.4g} {unit}/s",
                "acceleration": f"{a[i]:.4g} {unit}/s^2",
                "jerk": f"{j[i]:.4g} {unit}/s^3",
            }
        )
    lim = np.array(limits, float)
    if pick() < 0.06:  # no rail
        joints, lim = joints[1:], lim[1:]
    n = len(joints)
    arm = {
        "name": "arm",
        "convention": "modified",
        "lengths": {f"L{i + 1}": f"{x} mm" for i, x in enumerate(lengths)},
        "joints": joints,
    }
    if pick() < 0.1:
        arm["characteristic_length"] = f"{u(100, 1000):.3g} mm"
    if pick() < 0.15:
        arm["base"] = {
            "position": [f"{x:.1f} mm" for x in u(-500, 500, 3)],
            "rpy": [f"{x:.1f} deg" for x in u(-180, 180, 3)],
        }
    if pick() < 0.2:
        arm["tool"] = {
            "position": [f"{x:.1f} mm" for x in u(-80, 80, 3)],
            "rpy": [f"{x:.1f} deg" for x in u(-40, 40, 3)],
        }
    home_kind = rng.choice(["zero", "zero", "random", "limit", "middle"])
    radius = round(float(u(400, 800)) if mode == "near" else lu(rng, 150, 900), 1)
    if mode == "near":
        e0, a0 = u(-20, 20), u(-70, 10)
        el, az = [e0, e0 + u(10, 50)], [a0, a0 + u(20, 100)]
    else:
        e0 = u(-75, 70)
        el = [e0, min(e0 + u(4, 60), 87)]
        a0 = u(-190, 170)
        az = [a0, a0 + u(6, 120)]
    size = pick()
    if size < 0.15:
        rows, points = 2 + int(u(0, 2)), 2 + int(u(0, 3))
    elif size < 0.75:
        rows, points = int(u(2, 7)), int(u(4, 25))
    elif size < 0.95:
        rows, points = int(u(4, 13)), int(u(10, 50))
    else:
        rows, points = int(u(12, 26)), int(u(50, 121))
    proc = {"rows": rows, "points": points, "feed": f"{lu(rng, 1, 300):.3g} mm/s"}
    if pick() < 0.3:
        proc["stand_off"] = f"{u(0, 30):.1f} mm"
    if pick() < 0.5:
        proc["clearance"] = f"{u(1, 80):.1f} mm"
    if pick() < 0.3:
        proc["position_tolerance"], proc["rotation_tolerance"] = (
            f"{lu(rng, 0.2, 20):.2g} um",
            f"{lu(rng, 2, 100):.2g} urad",
        )
    if pick() < 0.2:
        proc["position_between"], proc["rotation_between"] = (
            f"{lu(rng, 20, 100):.2g} um",
            f"{lu(rng, 100, 500):.2g} urad",
        )
    if pick() < 0.3:
        proc["jump"] = f"{u(15, 90):.3g} deg"
    if pick() < 0.15:
        proc["tool_spin"] = "free"
    if pick() < 0.15:
        proc["tool_tilt"] = f"{u(1, 30):.3g} deg"
    sm = {}
    if pick() < 0.3:
        sm["points"] = min(int(u(0, 4)), (points - 1) // 2)
    if pick() < 0.3:
        sm["transition"], sm["lift"] = "lift", f"{u(2, 50):.1f} mm"
    if pick() < 0.2:
        sm["row_end"], sm["overrun"] = "flow", f"{u(1, 12):.1f} mm"
    proc["self_motion"] = sm
    doc = {
        "schema": 1,
        "name": name,
        "arm": arm,
        "workpiece": {"shape": "sphere zone", "radius": f"{radius} mm"},
        "process": proc,
    }
    options = {
        "timing": "ruckig" if pick() < 0.25 else "quintic",
        "for_linear": bool(pick() < 0.12),
        "strategy": "reverse" if pick() < 0.2 and "tool_spin" not in proc and "tool_tilt" not in proc else "graph",
        "seed": int(u(0, 4)),
    }
    biased = pick() < 0.8

    def fmt(z):
        return [f"{x:.2f} deg" for x in z]

    np.ones(n)
    pr = np.array([jj["type"] == "prismatic" for jj in joints])
    toSI = np.where(pr, 1e-3, np.pi / 180)
    lim * toSI[:, None]
    unit = ["mm" if x else "deg" for x in pr]

    def home():
        if home_kind == "zero":
            h = np.clip(np.zeros(n), lim[:, 0], lim[:, 1])
        elif home_kind == "middle":
            h = lim.mean(1)
        elif home_kind == "limit":
            h = np.where(rng.random(n) < 0.4, lim[np.arange(n), rng.integers(0, 2, n)], lim.mean(1))
        else:
            h = u(lim[:, 0], lim[:, 1])
        return [f"{x:.1f} {t}" for x, t in zip(h, unit, strict=False)]

    tries = 10 if biased else 1
    best, score = None, -1
    for t in range(tries):
        shrink = 0.7 ** (t // 2)
        em, am = np.mean(el), np.mean(az)
        e = [em + (el[0] - em) * shrink, em + (el[1] - em) * shrink]
        z = [am + (az[0] - am) * shrink, am + (az[1] - am) * shrink]
        work = {"shape": "sphere zone", "radius": f"{radius} mm", "elevation": fmt(e), "azimuth": fmt(z)}
        doc["workpiece"] = work
        arm["home"] = home()
        if mode == "near":
            work["pose"] = {
                "position": [f"{x:.1f} mm" for x in np.array([0, 1500 + (radius - 600) * 0.8, 360]) + u(-150, 150, 3)],
                "rpy": fmt(u(-15, 15, 3)),
            }
        elif mode == "wild" and not biased:
            work["pose"] = {"position": [f"{x:.1f} mm" for x in u(-900, 900, 3)], "rpy": fmt(u(-180, 180, 3))}
        else:
            work["pose"] = {"position": ["0 mm"] * 3, "rpy": ["0 deg"] * 3}
            c = Cell(doc)
            q = c.limits.mean(1) + (c.limits[:, 1] - c.limits[:, 0]) * u(-0.38, 0.38, n)
            p, r = c.fk(q)
            pl, rl = c.nominal_local(np.deg2rad(am), np.deg2rad(em))
            wr = r[0] @ rl.T
            wp = p[0] - wr @ pl
            work["pose"] = {
                "position": [f"{x * 1e3:.1f} mm" for x in wp],
                "rpy": [f"{np.rad2deg(x):.2f} deg" for x in rpy_of(wr)],
            }
        c = Cell(doc)
        if not biased:
            best = (dict(work), arm["home"])
            break
        hp, _ = c.fk(c.home)
        s = 1 if np.linalg.norm(c.local(hp)) > c.radius + c.clearance else 0
        for ee in c.elevation:
            for zz in c.azimuth:
                p0, r0 = c.nominal(zz, ee)
                s += c.ik(p0, r0, np.random.default_rng(1), starts=12, iterations=60)[0] < 1e-7
        if s > score:
            best, score = (dict(work), arm["home"]), s
        if score == 5:
            break
    doc["workpiece"], arm["home"] = best
    c = Cell(doc)
    length = sum(c.r * np.cos(e) * (c.azimuth[1] - c.azimuth[0]) for e in c.els)
    guess = length / c.feed + 3 * rows + 15
    if guess > 4000:  # keep the files in bounds
        proc["feed"] = f"{length / 4000 * 1e3:.3g} mm/s"
        guess = 4000 + 3 * rows
    options["period_ms"] = 4 if guess < 150 else int(np.ceil(guess / 40000 * 1000 / 2) * 2)
    return doc, options


def toml(doc: dict[str, Any]) -> str:
    """Return a cell as the text of its file."""

    def val(x):
        if isinstance(x, bool):
            return str(x).lower()
        if isinstance(x, str):
            return '"' + x + '"'
        if isinstance(x, (list, tuple)):
            return "[" + ", ".join(val(y) for y in x) + "]"
        if isinstance(x, dict):
            return "{ " + ", ".join(f"{k} = {val(v)}" for k, v in x.items()) + " }"
        return str(x)

    out = [f"schema = {doc['schema']}", f"name = {val(doc['name'])}", "", "[arm]"]
    arm = doc["arm"]
    out += [f"{k} = {val(v)}" for k, v in arm.items() if k != "joints"]
    for jt in arm["joints"]:
        out += ["", "[[arm.joints]]"] + [f"{k} = {val(v)}" for k, v in jt.items()]
    out += ["", "[workpiece]"] + [f"{k} = {val(v)}" for k, v in doc["workpiece"].items()]
    out += ["", "[process]"] + [f"{k} = {val(v)}" for k, v in doc["process"].items()]
    return "\n".join(out) + "\n"
