"""How long a whole map of link lengths takes at all-points reach fidelity, and whether its verdicts are right.

    python -m comparisons.reach_map [--quick] [--out FOLDER]

The map: 41 x 41 designs of the reference cell, L1 from 300 to 600 mm and L3 from 300 to 500 mm, 915 poses each, in one
call of ``qparm.reach_of_designs``. Its verdicts against four sources:

- the counts of poses out of reach that were found independently (exhaustive closed-form inverse kinematics);
- geometry of a spherical-wrist arm (``comparisons.wrist_arm``): every pose missed without proof;
- ``qparm.check_reach`` with many starts, on random designs of the map;
- another seed and more starts.

Exit status 1 if one of them disagrees, or the map took longer than its bar on two cores.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import qparm
from comparisons.tables import save_table
from comparisons.wrist_arm import best_margin

BAR = 60.0
# (L1, L3) in mm, and how many of 915 poses are out of reach
FACTS = {
    (480, 418): 0,
    (500, 400): 0,
    (480, 460): 0,
    (600, 480): 0,
    (480, 400): 0,
    (480, 391): 0,
    (340, 500): 0,
    (460, 400): 2,
    (440, 380): 12,
    (300, 480): 20,
}


def chain_of(chain: qparm.SerialChain, L1: float, L3: float) -> qparm.SerialChain:
    """Return the reference arm with other lengths (mm): L1 shifts joint 2 along the link, L3 joint 6."""
    joints = list(chain.joints)
    for i, length, axis in ((1, L1, 0), (5, L3, 1)):
        transform = np.array(joints[i].transform_previous_joint)
        transform[axis, 3] = np.sign(transform[axis, 3]) * length * 1e-3
        joints[i] = replace(joints[i], transform_previous_joint=transform)
    return replace(chain, joints=tuple(joints))


def cell_of(L1: float, L3: float) -> qparm.Cell:
    """Return the reference cell with other lengths (mm), read as any cell is."""
    import tomllib

    data = tomllib.loads(Path("examples/dome.toml").read_text(encoding="utf-8"))
    data["arm"]["lengths"].update(L1=f"{L1!r} mm", L3=f"{L3!r} mm")
    return qparm.Cell.load(data)


def main() -> int:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="9 x 9 designs, no bar")
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    size = 9 if arguments.quick else 41
    cell = qparm.Cell.load("examples/dome.toml")
    chain, poses = cell.chain(), cell.tool_path().poses
    np.testing.assert_allclose(chain_of(chain, 350, 470).fixed, cell_of(350.0, 470.0).chain().fixed, atol=1e-15)
    pairs = [(L1, L3) for L1 in np.linspace(300, 600, size) for L3 in np.linspace(300, 500, size)]
    qparm.reach_of_designs([chain], poses)  # compile

    start, cpu = time.perf_counter(), time.process_time()
    designs = [chain_of(chain, *pair) for pair in pairs]
    found = qparm.reach_of_designs(designs, poses)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu

    facts = qparm.reach_of_designs([chain_of(chain, *pair) for pair in FACTS], poses).missed.tolist()
    facts_hold = facts == list(FACTS.values())

    unproved = np.argwhere(~found.reached & ~found.proved)
    margins = [best_margin(cell_of(*map(float, pairs[d])), poses[k]) for d, k in unproved]
    contradicted = sum(margin > 0 for margin in margins)

    again = qparm.reach_of_designs(designs, poses, restarts=100, seed=1)
    flipped = int((again.reached != found.reached).sum())

    sample = np.random.default_rng(0).choice(len(designs), 4 if arguments.quick else 12, replace=False)
    differing = 0
    for d in sample:
        verdicts = qparm.check_reach(designs[d], poses, rng=np.random.default_rng(int(d)))
        differing += int(((np.array([v.reason.value for v in verdicts]) == "within reach") != found.reached[d]).sum())

    missed = found.missed
    rows = [
        ["designs x poses", f"{len(designs)} x {len(poses)}"],
        ["time of the map, wall", f"{wall:.1f} s"],
        ["... CPU time / 2", f"{cpu / 2:.1f} s"],
        ["designs that reach all poses", f"{(missed == 0).sum()}"],
        ["verdicts: reached", f"{found.reached.sum()}"],
        ["... out of reach, proved", f"{found.proved.sum()}"],
        ["... not reached, by search", f"{len(unproved)}"],
        ["of those, reachable by the arm's geometry", f"{contradicted}"],
        ["... nearest to reachable (cosine)", f"{max(margins, default=-np.inf):.1e}"],
        ["verdicts that another seed and 100 starts change", f"{flipped}"],
        [f"verdicts that check_reach sees otherwise, {len(sample)} designs", f"{differing}"],
        ["counts of " + ", ".join(f"({a}, {b})" for a, b in FACTS), ", ".join(map(str, facts))],
    ]
    print(save_table(arguments.out, "reach_map", "Reach of a map of link lengths", ["", "seen"], rows))
    within_bar = arguments.quick or wall <= BAR
    return 0 if facts_hold and within_bar and not (contradicted or flipped or differing) else 1


if __name__ == "__main__":
    raise SystemExit(main())
