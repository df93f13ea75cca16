"""The report of a study for the person building the arm: a summary in words, and everything as plain data."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.cell.design import MEASURES
from qparm.design.evaluate import LEVELS, REACH, Evaluation
from qparm.design.run import total_violation
from qparm.design.space import shown
from qparm.reports.words import time_words

if TYPE_CHECKING:
    from qparm.design.study import DesignStudy

__all__ = ["beyond_limits", "on_bounds", "study_data", "study_text", "why_not_own"]

# Nearer to an end of its range than this share of it, a variable lies on the bound.
_ON_BOUND = 0.02
_MOST_SHOWN = 12


def on_bounds(study: DesignStudy, x: tuple[float, ...]) -> list[tuple[str, str, float]]:
    """Return which variables of a design lie on an end of their range: key, side and bound."""
    found = []
    for variable, value in zip(study.problem.variables, x, strict=True):
        near = _ON_BOUND * (variable.upper - variable.lower)
        if value - variable.lower <= near:
            found.append((variable.name, "lower", variable.lower))
        elif variable.upper - value <= near:
            found.append((variable.name, "upper", variable.upper))
    return found


def why_not_own(study: DesignStudy) -> str:
    """Return how the cell's own design compares with what was found, and why it is not what is recommended."""
    own, space = study.own, study.space
    violation = total_violation(space, own)
    if violation > 0:
        return f"it is not valid: {own.reason or beyond_limits(study, own)}"
    if study.least is None:
        return "it is valid; the search found no other that is"
    least = study.evaluations[study.least]
    longer = own.measures["length"] - least.measures["length"]
    sentences = []
    sought = _border_followed(study)
    if longer > 1e-6:
        moves = ", ".join(
            f"{name} {shown(a - b, dimension)}"
            for name, a, b, dimension in zip(space.names, least.x, own.x, space.dimensions, strict=True)
            if abs(a - b) > 1e-6
        )
        which = "that still does" if sought else "met"
        sentences.append(
            f"it covers the surface with reach to spare: the shortest design {which} is"
            f" {shown(longer, 'length', digits=4)} shorter ({moves})"
        )
        held = on_bounds(study, least.x) if sought else []
        for key, side, bound in held:
            sentences.append(f"that one is held by the range: {_bound_words(study, key, side, bound)}")
        if sought and not held:
            sentences.append("that one is held by reach alone: any shorter arm in these ranges misses points")
    else:
        sentences.append(f"no shorter design {'in these ranges' if sought else 'met'} covers the surface")
    signs = [MEASURES[name].sense for name in study.objectives]
    if all(name in own.measures for name in study.objectives):
        mine = np.array([sign * own.measures[name] for sign, name in zip(signs, study.objectives, strict=True)])
        better = [
            k for k in study.best
            if (_values(study, k) <= mine).all() and (_values(study, k) < mine - 1e-12).any()
        ]  # fmt: skip
        if better:
            best = study.evaluations[better[len(better) // 2]]
            sentences.append(
                f"{space.shown(best.x)} is better in {_all_objectives(study)} ({_objective_words(study, best)})"
            )
        else:
            sentences.append(f"no design found is better in {_all_objectives(study)}")
            sentences += _beats_recommended(study, mine)
    return "; ".join(sentences)


def _border_followed(study: DesignStudy) -> bool:
    """Return whether the shortest design was sought to the last step."""
    return study.border == "followed"


def _unseen(study: DesignStudy) -> tuple[str, ...]:
    """Return the cell's objectives that the search did not look at."""
    return tuple(name for name in study.space.design.objectives if name not in study.objectives)


def _all_objectives(study: DesignStudy) -> str:
    return "all objectives that were looked at" if _unseen(study) else "all objectives"


def _beats_recommended(study: DesignStudy, mine: np.ndarray) -> list[str]:
    """Return a sentence where the cell's own design, with these values, beats the recommended one; else nothing."""
    if study.chosen is None:
        return []
    theirs = _values(study, study.chosen)
    less = mine < theirs - 1e-12
    if not less.any() or (mine > theirs).any():
        return []
    words = _all_objectives(study)
    if not less.all():
        names = " and ".join(name for name, one in zip(study.objectives, less, strict=True) if one)
        words = f"{names.replace('_', ' ')} and no worse in the others"
    x, variables = study.own.x, study.problem.variables
    inside = all(one.lower <= value <= one.upper for one, value in zip(variables, x, strict=True))
    why = "the search did not meet it" if inside else "it lies outside these ranges"
    return [f"it is itself better than the recommended design in {words}: {why}"]


def study_text(study: DesignStudy) -> str:
    """Return the summary."""
    space = study.space
    searched = study.evaluations[: study.stages[0][1]]
    valid = [one for one in searched if study.valid(one)]
    points = max((one.checked for one in study.evaluations), default=0)
    lines = [
        f"{space.cell.name}: {_count(len(space.keys), 'variable')}, method {study.method}, seed {study.seed};"
        f" {study.stopped}"
    ]
    width = max(14, *(len(name) + 2 for name in space.names))
    for variable, name, dimension in zip(study.problem.variables, space.names, space.dimensions, strict=True):
        low, high = shown(variable.lower, dimension), shown(variable.upper, dimension)
        lines.append(f"  {name:<{width}}{low} to {high}   ({variable.name})")
    lines.append("")
    relaxation = study.space.cell.relaxation()
    free = f", {relaxation.words}" if relaxation.free else ""
    lines.append(f"valid           {len(valid)} of {len(searched)} designs cover all {points} points{free}")
    for what, count in _refusals(study, searched).items():
        lines.append(f"                {count} {what}")
    lines.append(f"budget          {_spent(study)}")
    if study.second_step is not None:
        step = study.second_step
        box = ", ".join(
            f"{name} {shown(low, dimension)} to {shown(high, dimension)}"
            for name, low, high, dimension in zip(space.names, step.lower, step.upper, space.dimensions, strict=True)
        )
        lines.append(f"second step     after {step.first} designs, of {box} ({step.valid_share:.0%} valid in it)")
    if study.least is None:
        lines += _nothing_valid(study)
    else:
        lines += _found(study)
    lines += [
        "",
        f"the cell's own  {space.shown(study.own.x)}: {_measure_words(study.own)}",
        f"  {why_not_own(study)}",
        "",
    ]
    lines += _times(study)
    return "\n".join(lines)


def _why_not_followed(study: DesignStudy) -> str:
    if study.border == "cut short":
        return "not followed to its end: the budget was spent (--budget, --border)"
    affine = any(one.name == "length" and one.exact is not None for one in study.problem.objectives)
    why = "none of the budget was kept for it" if affine else "the length is not affine in these variables"
    return f"not followed: {why}"


def _spent(study: DesignStudy) -> str:
    """Return where the budget went."""
    words = {
        "search": "to search",
        "least length": "to follow the border of the valid designs to the shortest",
        "beside the recommended": "beside the recommended design, to see whether it has reserve",
        "own": "the cell's own",
    }
    parts = [f"{count} {words[name]}" for name, count in study.stages if count]
    if left := study.budget - sum(count for _, count in study.stages):
        parts.append(f"{left} not needed")
    return f"{_count(study.budget, 'design')}: {', '.join(parts)}"


def _found(study: DesignStudy) -> list[str]:
    space = study.space
    assert study.least is not None
    least = study.evaluations[study.least]
    met = "" if _border_followed(study) else " met"
    lines = [f"{'shortest' + met:<16}{space.shown(least.x)}: {_measure_words(least)}"]
    if met and "length" in study.objectives:
        lines.append(
            f"                the border of the valid designs was {_why_not_followed(study)}; shorter ones may be valid"
        )
    lines.append("")
    names = ", ".join(
        f"{MEASURES[name].words}{' (more is better)' * (MEASURES[name].sense < 0)}" for name in study.objectives
    )
    whose = "of the swarm's own search " if study.method == "paper" else ""
    lines.append(f"no design {whose}beats {_count(len(study.front), 'design')} in: {names}")
    if unseen := _unseen(study):
        why = "method paper has its own objectives" if study.method == "paper" else f"not told at level {study.level}"
        words = ", ".join(MEASURES[name].words for name in unseen)
        lines.append(f"NOT LOOKED AT   {words}: {why}")
    step = max(1, -(-len(study.front) // _MOST_SHOWN))
    kept = {*study.front[::step], study.front[-1], study.chosen}
    shown_ = [place for place in study.front if place in kept]
    for place in shown_:
        one = study.evaluations[place]
        mark = "->" if place == study.chosen else "  "
        lines.append(f"  {mark} {space.shown(one.x)}: {_objective_words(study, one)}")
    for place in study.best:
        if place not in study.front:
            one = study.evaluations[place]
            mark = "->" if place == study.chosen else "  "
            lines.append("the followed border leads to a design that the search did not find")
            lines.append(f"  {mark} {space.shown(one.x)}: {_objective_words(study, one)}; {_beaten(study, place)}")
    lines += _recommended(study)
    for bound in study.active:
        words = _bound_words(study, bound.variable, bound.side, bound.bound)
        helped = ", ".join(MEASURES[name].words for name in bound.objectives)
        lines.append(f"limited by      {words}: beyond it {helped} would gain; this bound was chosen, not found")
    held = [one for one in on_bounds(study, least.x) if one[0] not in {bound.variable for bound in study.active}]
    for key, side, bound in held:
        lines.append(f"                the shortest design{met} lies on {_bound_words(study, key, side, bound)}")
    for pair, tau in study.rank_consistency.items():
        lines.append(f"rank            {pair}: Kendall's tau {tau:.2f} over the planned designs")
    return lines


def _beaten(study: DesignStudy, place: int) -> str:
    """Return how many of the search's front a design beats."""
    mine = _values(study, place)
    others = [_values(study, k) for k in study.front]
    beaten = sum(bool((mine <= other).all() and (mine < other).any()) for other in others)
    return f"it beats {beaten} of the {len(others)} above" if beaten else "it beats none of those above"


def _recommended(study: DesignStudy) -> list[str]:
    lines = [""]
    if study.unmoved:
        words = " and ".join(MEASURES[name].words for name in study.unmoved)
        lines.append(f"{words}: the same for all valid designs, no choice can go by it")
    if study.chosen is None:
        lines.append("NO RECOMMENDATION: nothing tells the valid designs apart; other objectives may")
        return lines
    chosen = study.evaluations[study.chosen]
    lines += [f"recommended     {study.space.shown(chosen.x)}", f"  {_measure_words(chosen)}"]
    grounds = {
        "knee": "the knee: farthest below the line between the extreme designs",
        "only": f"no other is needed: it is the best in {_all_objectives(study)}",
    } | {
        name: f"the front has no knee (it is straight or bulges the other way); the most {MEASURES[name].words} of it"
        for name in ("limit_margin", "singularity_margin")
    }
    lines.append(f"  {grounds[study.grounds]}")
    if study.beyond_reach:
        lines.append(f"  no reserve: it lies on the border of reach ({study.beyond_reach})")
    elif study.beyond_reach is None:
        lines.append("  whether it has reserve was not looked at: the budget left no designs for that")
    return lines


def _count(number: int, word: str) -> str:
    return f"{number} {word if number == 1 else word + 's'}"


def _nothing_valid(study: DesignStudy) -> list[str]:
    nearest = study.nearest
    assert nearest is not None
    lines = [
        "",
        "NO VALID DESIGN was found in these ranges.",
        f"nearest         {study.space.shown(nearest.x)}: covers"
        f" {'' if nearest.level >= REACH else 'at most '}{nearest.coverage:.2%};"
        f" {nearest.reason or beyond_limits(study, nearest)}",
    ]
    lines += [f"  {line}" for line in study.misses]
    lines.append("wider ranges, a workpiece that stands nearer, or wider joint limits may help")
    return lines


def _refusals(study: DesignStudy, searched: tuple[Evaluation, ...]) -> dict[str, int]:
    counts = {
        "proved out of the links' reach": 0,
        "not reached within joint limits (a search, no proof)": 0,
        "beyond a limit on a measure": 0,
        "not a valid cell": 0,
    }
    for one in searched:
        if one.checked == 0:
            counts["not a valid cell"] += 1
        elif one.violation > 0:
            counts[list(counts)[0 if one.level == 0 else 1]] += 1
        elif study.violation(one) > 0:
            counts["beyond a limit on a measure"] += 1
    return {what: count for what, count in counts.items() if count}


def beyond_limits(study: DesignStudy, one: Evaluation) -> str:
    """Return which limits on measures a design is beyond; empty where it keeps those that were looked at."""
    words = []
    for name, limit in study.space.design.limit_values().items():
        value = one.measures.get(name)
        if value is not None and MEASURES[name].sense * (value - limit) > 0:
            dimension = MEASURES[name].dimension
            words.append(f"{MEASURES[name].words} is {shown(value, dimension)}, the limit {shown(limit, dimension)}")
    return "; ".join(words)


def _values(study: DesignStudy, place: int) -> np.ndarray:
    one = study.evaluations[place]
    return np.array([MEASURES[name].sense * one.measures[name] for name in study.objectives])


def _objective_words(study: DesignStudy, one: Evaluation) -> str:
    return ", ".join(
        f"{name.replace('_', ' ')} {shown(one.measures[name], MEASURES[name].dimension, digits=4)}"
        for name in study.objectives
    )


def _measure_words(one: Evaluation) -> str:
    if not one.valid:
        return one.reason
    return ", ".join(
        f"{name.replace('_', ' ')} {shown(one.measures[name], measure.dimension, digits=5)}"
        for name, measure in MEASURES.items()
        if name in one.measures
    )


def _bound_words(study: DesignStudy, key: str, side: str, bound: float) -> str:
    place = [variable.name for variable in study.problem.variables].index(key)
    sign = ">=" if side == "lower" else "<="
    return f"{study.space.names[place]} {sign} {shown(bound, study.space.dimensions[place])}"


def _times(study: DesignStudy) -> list[str]:
    levels = ", ".join(
        f"{LEVELS[level]} {time_words(seconds / count)} x {count}"
        for level, (count, seconds) in sorted(study.level_seconds.items())
    )
    return [f"time            {study.seconds:.1f} s; a design: {levels or 'all from the journal'}"]


def study_data(study: DesignStudy) -> dict[str, Any]:
    """Return everything about a study as plain data, for ``design.json``."""
    from qparm.reports.plan import versions

    space = study.space

    def point(place: int | None) -> dict[str, Any] | None:
        return None if place is None else {"place": place, **_told(study, study.evaluations[place])}

    return {
        "cell": space.cell.to_dict(),
        "method": study.method,
        "level": study.level,
        "objectives": [
            {"name": name, "sense": MEASURES[name].sense, "words": MEASURES[name].words} for name in study.objectives
        ],
        "objectives_not_looked_at": list(_unseen(study)),
        "seed": study.seed,
        "budget": study.budget,
        "stopped": study.stopped,
        "stages": [{"name": name, "designs": count} for name, count in study.stages],
        "variables": [
            {
                "key": variable.name,
                "name": name,
                "dimension": dimension,
                "range": [variable.lower, variable.upper],
                "hard": [variable.hard_lower, variable.hard_upper],
            }
            for variable, name, dimension in zip(study.problem.variables, space.names, space.dimensions, strict=True)
        ],
        "chosen": point(study.chosen),
        "border": study.border,
        "border_followed": _border_followed(study),
        "shortest": point(study.least),
        "shortest_of_search": point(study.least_of_search),
        "second_step": None if study.second_step is None else asdict(study.second_step),
        "own": _told(study, study.own) | {"compared": why_not_own(study)},
        "least_violating": None if study.nearest is None else _told(study, study.nearest),
        "missed": list(study.misses),
        "grounds": study.grounds,
        "same_for_all": list(study.unmoved),
        "border_of_reach": study.beyond_reach,
        "front": [point(place) for place in study.front],
        "best_of_all": list(study.best),
        "active_bounds": [
            {
                "variable": bound.variable,
                "side": bound.side,
                "bound": bound.bound,
                "hard": bound.hard,
                "objectives": list(bound.objectives),
            }
            for bound in study.active
        ],
        "shortest_on_bounds": []
        if study.least is None
        else [
            {"variable": key, "side": side, "bound": bound}
            for key, side, bound in on_bounds(study, study.evaluations[study.least].x)
        ],
        "rank_consistency": study.rank_consistency,
        "seconds": {
            "total": study.seconds,
            "levels": {
                LEVELS[level]: {"runs": count, "total": seconds, "each": seconds / count}
                for level, (count, seconds) in sorted(study.level_seconds.items())
            },
        },
        "journal_hash": study.journal_hash,
        "versions": versions(),
    }


def _told(study: DesignStudy, one: Evaluation) -> dict[str, Any]:
    return {
        "x": dict(zip(study.space.keys, one.x, strict=True)),
        "level": LEVELS[one.level],
        "valid": study.valid(one),
        "violation": study.violation(one),
        "coverage": one.coverage,
        "missed": one.missed,
        "checked": one.checked,
        "reason": one.reason or beyond_limits(study, one),
        "measures": one.measures,
    }
