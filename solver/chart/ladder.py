"""The model ladder: what leaving a term out of a scene costs in accuracy, and what it saves in time.

A model is the scene without some of its terms. Five can be left out of the kernel ("impulse" is compiled
for a `law`); one of these is the sweep over several contacts, without which only the deepest point touches,
as in the article. Rounding and curvature are left out of the scene: sharp points where the round ones would
touch, and the plane that touches the ground under the start.

Errors are the larger of the attitude's, rad, and the position's over the body's bounding radius, at the end
of a short run. They come from "impulse", at 240 Hz and with FINE times smaller steps, where the step's own
error is gone: so a term that only makes a step accurate (the centripetal one, as positions are put right
anyway) can be told from one that makes the model right.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from time import perf_counter

import numpy as np

from solver import impulse
from solver.body import Body
from solver.errors import SolverError
from solver.model import MEMORY
from solver.rotation import to_matrix
from solver.scene import Scene, State, to_kernel, to_principal
from solver.simulate import simulate
from solver.surface import HeightField, Plane
from solver.terms import Law, full, present

from .ladder_scenes import Case, cases
from .problems import off

H = 1 / 240
FINE = 50
ROUNDS = 400

LAW = {"friction": 0, "restitution": 1, "gyroscopic": 2, "sweep": 3, "centripetal": 4}
"""Terms of the kernel: their place in its `law`."""

TERMS = (*LAW, "rounding", "curvature")
NOTHING = "nothing"

TIE = 0.03
"""Times that differ by less are the same: of such models the least is the one with fewer terms."""

QUICK = ("free spin", "sphere rolls down")
QUICK_TERMS = ("friction", "rounding", "curvature")
"""Of a quick run: one kernel without a term is enough to compile."""


# -------------------------------------------------------------------------------------- models and runs


def sharp(case: Case) -> Scene:
    """The scene with points without radius where the round ones would touch first, at the start."""
    scene, R = case.scene, to_matrix(case.start.quat[0])
    body, ground = scene.body, scene.surface
    if not body.radius.any():
        return scene
    N = np.tile(ground.parameters[:3], (len(body.hull), 1))
    if isinstance(ground, HeightField):
        N = ground.feet(case.start.x[0] + body.hull @ R.T)[:, 1:4]
    points = body.hull - body.radius[:, None] * (N @ R)
    return altered(scene, Body(body.m, body.J, points), ground)


def flattened(case: Case) -> Scene:
    """The scene on the plane that touches its ground under the hull point nearest to it at the start."""
    scene, ground = case.scene, case.scene.surface
    if not isinstance(ground, HeightField):
        return scene
    k = scene.gap(case.start)[0].argmin()
    point = case.start.x[0] + to_matrix(case.start.quat[0]) @ scene.body.hull[k]
    foot = ground.feet(point)
    return altered(scene, scene.body, Plane(foot[1:4], point - foot[0] * foot[1:4]))


def altered(scene: Scene, body: Body, ground: Plane | HeightField) -> Scene:
    """The scene with another body and ground."""
    return Scene(body, ground, scene.gravity, scene.friction, scene.restitution)


def without(case: Case, left: Sequence[str]) -> Scene:
    """The model that leaves these terms out and has every other, needed or not."""
    if "curvature" in left:
        case = Case(case.name, flattened(case), case.start)
    scene = sharp(case) if "rounding" in left else altered(case.scene, case.scene.body, case.scene.surface)
    law: Law = full(scene.friction, scene.restitution)
    for term, at in LAW.items():
        if term in left:
            law = (*law[:at], None, *law[at + 1 :])  # type: ignore[assignment]
    scene.law = law
    return scene


def in_explain(case: Case, term: str) -> bool:
    """Is the term in the scene, as `Scene.explain` has it?"""
    scene = altered(case.scene, case.scene.body, case.scene.surface)
    said = present(scene.body, scene.friction, scene.law, scene.surface.field)
    return {name: is_in for name, is_in, _why in said}[term]


def end(case: Case, scene: Scene, dt: float = H, method: str = "impulse") -> State:
    """Where it ends."""
    run = simulate(scene, case.start, case.duration, dt, method, torque=case.torque, record_every=10**6)
    return run.state


def apart(case: Case, a: State, b: State) -> float:
    """The larger of the attitudes' difference, rad, and the positions' over the bounding radius."""
    return float(off(case.scene, a, b.x, b.quat)[0])


# ------------------------------------------------------------------------------- errors and times of a model


@cache
def fine(case: Case, left: tuple[str, ...] = ()) -> State:
    """Where a model ends in the limit of small steps."""
    return end(case, without(case, left), H / FINE)


@cache
def exactly(case: Case) -> State | None:
    """Where the scene ends by "exact", if that serves it."""
    try:
        return end(case, case.scene, case.duration, "exact")
    except (SolverError, ValueError):
        return None


def model_error(case: Case, left: tuple[str, ...]) -> float:
    """What leaving the terms out does, whatever the step; exactly 0 where they are zero."""
    return apart(case, fine(case, left), fine(case))


def error(case: Case, left: tuple[str, ...]) -> float:
    """Of a model at 240 Hz, the step's error in it."""
    return apart(case, end(case, without(case, left)), fine(case))


@cache
def order(case: Case) -> tuple[str, ...]:
    """The terms as they are left out one after another: first what is zero, then what matters least."""
    return tuple(sorted(TERMS, key=lambda term: (in_explain(case, term), error(case, (term,)))))


def idle(case: Case) -> int:
    """How many terms are zero in the scene."""
    return sum(not in_explain(case, term) for term in TERMS)


def measured(case: Case, left: tuple[str, ...], rounds: int) -> dict[str, object]:
    """A model's row: see `cells`."""
    model = without(case, left)
    coarse = end(case, model)
    true = exactly(case)
    whole, lean = timed(case, [without(case, ()), model], rounds)
    low, high = np.percentile(whole - lean, (10, 90))
    if true is None:
        note = "'exact' does not serve this scene"
    else:
        note = f"'exact' ends {apart(case, fine(case), true):.1e} from the whole model in small steps"
    return {
        "scene": case.name,
        "term": "+".join(left) or NOTHING,
        "in_explain": "in" if any(in_explain(case, term) for term in left) else "out",
        "error_model": model_error(case, left),
        "error_step": apart(case, coarse, fine(case, left)),
        "error": error(case, left),
        "error_exact": np.nan if true is None else apart(case, coarse, true),
        "ns_with": float(np.median(whole)),
        "ns_without": float(np.median(lean)),
        "ns_p10": float(low),
        "ns_p90": float(high),
        "note": note,
    }


def timed(case: Case, scenes: list[Scene], rounds: int) -> np.ndarray:
    """ns a step of each scene's run at 240 Hz, (scenes, rounds); they take turns, with an empty call each."""
    n = round(case.duration / H)
    calls = []
    for scene in scenes:
        start = to_kernel(scene.body, case.start)[0]
        points = len(scene.body.hull)
        state, memory, f = start.copy(), np.zeros((points, MEMORY)), np.zeros(points)
        torque = to_principal(scene.body, np.array(case.torque))
        what = (*scene.parameters[:3], scene.law, scene.gravity, torque, state, memory, f, np.zeros(1), H)
        calls.append((what, state, memory, start))
    times = np.zeros((len(scenes), rounds + 1, 2))
    for n_round in range(rounds + 1):  # the first warms up
        for j, (what, state, memory, start) in enumerate(calls):
            for k, steps in enumerate((0, n)):
                state[:], memory[:] = start, 0.0
                before = perf_counter()
                impulse.run(*what, steps)
                times[j, n_round, k] = perf_counter() - before
    empty = np.median(times[:, 1:, 0], axis=1)
    return 1e9 * (times[:, 1:, 1] - empty[:, None]) / n


# ------------------------------------------------------------------------------------- what is asked for


def cells(quick: bool, car: Body | None = None) -> list[tuple[str, Callable[[], dict[str, object]]]]:
    """Every measurement: a key, and what makes its row.

    Of each scene: nothing left out; each term by itself; and the greedy models, which leave out first
    every term that is zero, then one more at a time, that with the least error of its own first.

    A row has `scene`; `term` (several joined by +); `in_explain` ("out": every term left out is zero);
    `error_model` (in small steps, against the whole model so: exactly 0 where it is "out"), `error_step` (at
    240 Hz, against the same model in small steps), `error` (at 240 Hz, against the whole model in small
    steps) and `error_exact` (at 240 Hz, against "exact"; NaN where that does not serve); `ns_with`,
    `ns_without` (medians, ns a step), `ns_p10`, `ns_p90` (of what is saved); `note`.

    Args:
        quick: two scenes, few rounds, some terms, no greedy models.
        car: its body; without one the car's scenes are left out.
    """
    rounds = 5 if quick else ROUNDS
    found: list[tuple[str, Callable[[], dict[str, object]]]] = []
    for case in cases(car):
        if quick and case.name not in QUICK:
            continue
        found.append((f"{case.name}/{NOTHING}", partial(measured, case, (), rounds)))
        for term in QUICK_TERMS if quick else TERMS:
            found.append((f"{case.name}/{term}", partial(measured, case, (term,), rounds)))
        for k in range(max(2, idle(case)), 1 if quick else len(TERMS) + 1):
            found.append((f"{case.name}/greedy {k}", partial(_greedy, case, k, rounds)))
    return found


def _greedy(case: Case, k: int, rounds: int) -> dict[str, object]:
    return measured(case, order(case)[:k], rounds)


def least(rows: Sequence[dict], error: float) -> dict[str, tuple[str, ...]]:
    """Of each scene: the terms of the cheapest model whose error at 240 Hz is at most so large.

    It has no term that is zero in the scene. Times are compared as ratios to the whole model's, which took
    turns with it. A scene in which no model is so good is left out.

    Args:
        rows: as `cells` makes them, numbers perhaps as text.
        error: as in the rows.
    """
    answer = {}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        mine = [row for row in rows if row["scene"] == scene]
        zero = {row["term"] for row in mine if row["in_explain"] == "out"} & set(TERMS)
        good = [row for row in mine if float(row["error"]) <= error and zero <= left_out(row)]
        if good:
            cost = [float(row["ns_without"]) / float(row["ns_with"]) for row in good]
            cheap = [row for row, c in zip(good, cost, strict=True) if c <= (1 + TIE) * min(cost)]
            best = max(cheap, key=lambda row: len(left_out(row)))
            answer[scene] = tuple(term for term in TERMS if term not in left_out(best))
    return answer


def left_out(row: dict) -> set[str]:
    """The terms that a row's model does without."""
    return set(row["term"].split("+")) - {NOTHING}
