"""Work-precision: error against wall time, each method's curve by its step, or by its tolerance."""

import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from time import perf_counter

import numpy as np

from .engine import Engine, EngineError, Ours, Trajectory
from .problems import Problem
from .store import Cell, Row

RATES = tuple(30 * 2**n for n in range(11))
"""Steps a second: 1/30 s to 1/30720 s."""
QUICK_RATES = (30, 240)
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
QUICK_TOLERANCES = (1e-12,)

BUDGET = 10.0
"""s: a run that would take longer, by the one before it, is left out."""
QUICK_BUDGET = 0.5
ENOUGH = 0.5
"""s of playing, after which a run is not repeated."""
REPEATS = 7


def measured(problem: Problem, engine: Engine, steps: int, repeats: int) -> tuple[Row, float]:
    """One run of an engine, repeated for its time: a row, and the seconds that one run took.

    Args:
        problem: the scene.
        engine: what plays it.
        steps: in each of the problem's records.
        repeats: at most.
    """
    times: list[float] = []
    before = perf_counter()
    run = None
    reason = ""
    try:
        while len(times) < repeats and (not times or perf_counter() - before < ENOUGH):
            run = engine.play(
                problem.scene, problem.starts, problem.duration, problem.records, steps, problem.torque
            )
            times.append(run.ns_per_second)
    except EngineError as error:
        reason = str(error)
    took = (perf_counter() - before) / max(1, len(times))
    row: Row = {"error": "", "energy": "", "penetration": "", "ns": "", "ns_p10": "", "ns_p90": ""}
    if run is not None and not reason:
        off = problem.error(run)
        low, middle, high = np.percentile(times, [10, 50, 90])
        row = {
            "error": off,
            "energy": energy_error(problem, run) if problem.keeps else "",
            "penetration": max(
                0.0, -float(min(problem.scene.gap(run.at(n)).min() for n in range(len(run.t))))
            ),
            "ns": middle,
            "ns_p10": low,
            "ns_p90": high,
        }
        if not off < problem.wrong:
            reason = f"wrong: error {off:.2g}"
    return {**row, "failed": reason}, took


def energy_error(problem: Problem, run: Trajectory) -> float:
    """The largest change of the energy over the record, relative to what it can change by."""
    energies = np.array([problem.scene.energy(run.at(n)) for n in range(len(run.t))])
    ground = problem.scene.body.m * np.linalg.norm(problem.scene.gravity) * problem.scene.body.bounding_radius
    return float((np.abs(energies - energies[0]) / np.maximum(np.abs(energies[0]), ground)).max())


def curve(problem: Problem, engine: Engine, quick: bool) -> list[Row]:
    """An engine's errors and times with ever smaller steps; ends where it would take too long."""
    rows = []
    took, last = 0.0, 0
    for rate in QUICK_RATES if quick else RATES:
        steps = round(rate * problem.duration / problem.records)
        if last and took * steps / last > (QUICK_BUDGET if quick else BUDGET):
            break
        row, took = measured(problem, engine, steps, 1 if quick else REPEATS)
        last = steps
        rows.append({**_about(problem, engine), "parameter": "dt", "value": 1 / rate, **row})
    return rows


def exact_curve(problem: Problem, quick: bool) -> list[Row]:
    """The exact method's errors and times with ever smaller tolerances."""
    rows = []
    for tol in QUICK_TOLERANCES if quick else TOLERANCES:
        engine = Ours("exact", tol=tol)
        row, _took = measured(problem, engine, 1, 1 if quick else REPEATS)
        rows.append({**_about(problem, engine), "settings": "", "parameter": "tol", "value": tol, **row})
    return rows


def _about(problem: Problem, engine: Engine) -> Row:
    return {
        "scene": problem.name,
        "method": engine.name,
        "version": engine.version,
        "settings": json.dumps(engine.settings) if engine.settings else "",
    }


def cells(
    problems: Iterable[Problem], peers: Callable[[Problem], list[Engine]], quick: bool
) -> Iterator[Cell]:
    """A cell for each curve.

    Args:
        problems: the scenes.
        peers: other engines for a scene, set for it.
        quick: fewer and coarser steps.
    """
    for problem in problems:
        for method in ("impulse", "baumgarte", "acceleration"):
            yield (problem.name, method), partial(curve, problem, Ours(method, lean=not quick), quick)
        yield (problem.name, "exact"), partial(exact_curve, problem, quick)
        for engine in peers(problem):
            yield (problem.name, engine.name), partial(curve, problem, engine, quick)
