"""The stability map: the largest step, and the hardest scene, with which a method is still right.

Each cell is an engine in a scene of `stability_scenes`. Its value is the largest step of a fixed ladder
such that this and all shorter ones give the right kind of answer; or, with the step fixed at 1/240 s,
the hardest value of the scene's parameter such that this and all easier ones do.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from solver.chart.engine import Engine, EngineError, Ours
from solver.chart.stability_case import COARSEST, Case
from solver.chart.stability_limits import limit
from solver.chart.stability_naive import NAIVE, Naive
from solver.chart.stability_scenes import CASES

LADDER = tuple(COARSEST * 2**n for n in range(9, -1, -1))
"""Steps a second, the shortest step first."""

FIXED = 240
"""Steps a second where the scene's parameter is varied."""

EVENTS = {"exact": FIXED}
"""Methods without a step, whose dt is how often they are asked: finer than this is not tried."""

QUICK = (240, 30)
"""The ladder of a quick run; of a scene's parameter it takes the easiest, the nominal and the hardest."""

QUICK_SCENES = ("slender-spin", "slope", "overlap", "painleve-rod")
"""Played in moments by every method; "exact" takes half a minute for a slender box that lands flat."""

STEP = "dt"
"""What a cell varies if it is not the scene's parameter."""

Key = tuple[str, str, str]
"""Method, scene and what is varied."""

Row = dict[str, Any]


class Refused(Exception):
    """The engine does not take this scene or start; the message says why."""


def attempt(engine: Engine, case: Case, value: float, hz: int) -> tuple[bool, str]:
    """Whether an engine is right, and if it broke off, why.

    Args:
        engine: plays it.
        case: the scene.
        value: of the scene's parameter.
        hz: steps a second.

    Raises:
        Refused: the engine does not take it.
    """
    scene, starts, duration = case.build(value)
    rate = min(hz, case.rate)
    why = engine.refuses(scene)
    if why:
        raise Refused(why)
    try:
        run = engine.play(scene, starts, duration, round(duration * rate), hz // rate)
    except EngineError as error:
        return False, str(error).split("; state")[0]
    except ValueError as error:
        raise Refused(str(error)) from error
    if not all(np.isfinite(a).all() for a in (run.x, run.quat, run.v, run.w)):
        return False, "not finite"
    return bool(case.right(scene, run)), ""


def row(engine: Engine, case: Case, varied: str, tried: Sequence[float]) -> Row:
    """One cell.

    Args:
        engine: plays it.
        case: the scene.
        varied: `STEP`, or the scene's parameter.
        tried: steps a second, or values of the parameter; from the easiest to the hardest.

    Returns:
        kind ("ours", "naive" or "peer"), method, version, scene, varied, largest ("" if none), limit_analytic
        ("" if none is known), unit, note, tried (all that may be tried, in order, with semicolons). The
        note begins with "n/a" where the engine refuses, and with "never" where not even the easiest is
        right; it then names those that were.
    """
    by_step = varied == STEP
    values = [1.0 / x for x in tried] if by_step else list(tried)
    largest: float | str = ""
    note = ""
    judge = partial(attempt, engine, case)
    run = (lambda x: judge(case.nominal, int(x))) if by_step else (lambda x: judge(x, FIXED))
    try:
        for x, shown in zip(tried, values, strict=True):
            right, broke = run(x)
            if not right:
                note = broke
                break
            largest = shown
        if largest == "":
            later = [f"{shown:.6g}" for x, shown in zip(tried[1:], values[1:], strict=True) if run(x)[0]]
            only = f", but right at {' '.join(later)}" if later else ""
            note = f"never{only}" + (f": {note}" if note else "")
    except Refused as refused:
        largest, note = "", f"n/a: {refused}"
    known = limit(engine.name, case, varied)
    return {
        "kind": "ours" if isinstance(engine, Ours) else "naive" if isinstance(engine, Naive) else "peer",
        "method": engine.name,
        "version": engine.version,
        "scene": case.name,
        "varied": varied,
        "largest": largest,
        "limit_analytic": "" if known is None else known,
        "unit": "s" if by_step else case.unit,
        "note": note,
        "tried": ";".join(f"{x:.6g}" for x in values),
    }


def cells(
    engines: Iterable[Engine], quick: bool = False, cases: Sequence[Case] = CASES
) -> list[tuple[Key, Callable[[], Row]]]:
    """All cells of the map: what names one, and the call that makes its row.

    Args:
        engines: this solver's methods and its peers; the naive methods come by themselves.
        quick: a few scenes and values only.
        cases: the scenes.
    """
    made: list[tuple[Key, Callable[[], Row]]] = []
    for engine in (*engines, *NAIVE):
        finest = engine.finest if isinstance(engine, Naive) else EVENTS.get(engine.name, LADDER[0])
        ladder = [hz for hz in (QUICK if quick else LADDER) if hz <= finest]
        for case in cases:
            if isinstance(engine, Naive) and case.name not in engine.cases:
                continue
            if quick and case.name not in QUICK_SCENES:
                continue
            made.append(((engine.name, case.name, STEP), partial(row, engine, case, STEP, ladder)))
            if len(case.values) > 1:
                some = {case.values[0], case.nominal, case.values[-1]}
                values = [x for x in case.values if not quick or x in some]
                key = (engine.name, case.name, case.varied)
                made.append((key, partial(row, engine, case, case.varied, values)))
    return made
