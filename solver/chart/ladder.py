"""The model ladder: what leaving a term out of a scene costs in accuracy, and what it saves in time.

A model is the scene without some of its terms. Four of them are left out of the kernel ("impulse" is
compiled for a `law`), one is the sweep over several contacts, without which only the deepest point
touches, as in the article; rounding and curvature are left out of the scene: sharp points where the round
ones touch, and the plane that touches the ground under the start.

Errors are the larger of the attitude's, rad, and the position's over the body's bounding radius, at the end
of a short run. The model's own error is its distance from the whole model where both take FINE times
smaller steps; the step's is the model's distance from itself there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from solver.terms import Law, full

from .problems import ZERO, off, one, placed, turned

H = 1 / 240
FINE = 50
ROUNDS = 400

LAW = {"friction": 0, "restitution": 1, "gyroscopic": 2, "sweep": 3, "centripetal": 4}
"""Terms of the kernel: their place in its `law`."""

TERMS = (*LAW, "rounding", "curvature")
NOTHING = "nothing"


@dataclass(frozen=True, eq=False)
class Case:
    """A scene to leave terms out of.

    Attributes:
        name: a few words.
        scene: with every term it needs.
        start: a batch of one.
        duration: s.
        torque: (3,) N m, body axes, held.
    """

    name: str
    scene: Scene
    start: State
    duration: float = 0.5
    torque: tuple = ZERO


def cases(car: Body | None = None) -> list[Case]:
    """The scenes; those with a car only if there is one."""
    R = 0.1
    box, ball = Body.box(1.0, (0.3, 0.4, 0.5)), Body.sphere(1.0, R)

    spin = Scene(Body(1.0, (1e-3, 2e-3, 2.5e-3), [ZERO], radius=0.05), gravity=ZERO)
    top = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.09)], radius=0.01))
    skid = Scene(Body(1.0, np.full(3, 0.004), [(0, 0, -0.02)], radius=R), friction=0.1)
    roll = Scene(ball, Plane((np.sin(0.2), 0, np.cos(0.2))), friction=0.5)
    slide = Scene(box, friction=0.3)
    bounce = Scene(ball, restitution=0.8)
    rock = Scene(Body.box(1.0, (0.1, 0.2, 0.4)), friction=1.0)
    toss = Scene(box, friction=0.4, restitution=0.3)
    bumps = Scene(ball, HeightField.named("bumpy", height=0.03, spacing=0.5, size=8), friction=0.5)

    N, down = roll.surface.normal, np.array([np.cos(0.2), 0, -np.sin(0.2)])
    found = [
        Case("free spin", spin, one((0, 0, 1), w=(2, 10, 1))),
        Case("frictionless top", top, placed(top, one((0, 0, 0.1), w=(1, 0.5, 60)))),
        Case(
            "off-centre sphere skids",
            skid,
            placed(skid, one((0, 0, 0.2), turned((1, 0, 0), 0.6), (1, 0.3, 0), (20, -5, 10))),
        ),
        Case("sphere rolls down", roll, one(R * N, v=down, w=np.cross(N, down) / R)),
        Case("block slides", slide, one((0, 0, 0.25), v=(2, 0.5, 0), w=(0, 0, 3))),
        Case("ball bounces", bounce, one((0, 0, 0.4), v=(1, 0, 0), w=(3, 2, 1))),
        Case("block rocks", rock, placed(rock, one((0, 0, 0.2), turned((0, 1, 0), 0.15)))),
        Case("box tossed", toss, one((0, 0, 0.6), turned((0.6, 0, 0.8), 0.7), (1, 0.5, -1), (4, -3, 2))),
        Case("ball on bumpy ground", bumps, _rolling(bumps, (0.1, 0.05), (1.5, 0.7))),
    ]
    if car is not None:
        ground = Scene(car, friction=0.8)
        roof = placed(ground, one((0, 0, 1), turned((1, 0, 0), np.pi - 0.15)))
        crash = one((0, 0, 1.6), turned((1, 0, 0), 1.8), (12, 3, -3), (5, 1, 2))
        found += [
            Case("car on its roof, torque", ground, roof, torque=(3100.0, 0.0, 0.0)),
            Case("car rolls out of a crash", ground, crash),
        ]
    return found


def _rolling(scene: Scene, place: tuple, v: tuple) -> State:
    """A sphere that touches curved ground near a place and rolls, at v (2,) along x and y."""
    R, x = scene.body.bounding_radius, np.array([*place, 0.0])
    for _ in range(60):  # down to rounding: each leaves a small part of the gap
        foot = scene.surface.feet(x)
        x = x - (foot[0] - R) * foot[1:4]
    N = foot[1:4]
    v_com = np.array([*v, -(N[:2] @ v) / N[2]])
    return one(x, v=v_com, w=np.cross(N, v_com) / R)


QUICK = ("free spin", "sphere rolls down")


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
    own = altered(case.scene, case.scene.body, case.scene.surface)
    told = {line[:14].strip(): line[14:19].strip() for line in own.explain().splitlines()}
    return told[term] == "in"


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
def truth(case: Case) -> tuple[State, str]:
    """Where the scene ends by "exact" where that serves it, else by small steps; and which it was."""
    try:
        return end(case, case.scene, case.duration, "exact"), "exact"
    except (SolverError, ValueError):
        return fine(case), "small steps"


def model_error(case: Case, left: tuple[str, ...]) -> float:
    """What leaving the terms out does, whatever the step; exactly 0 where they are zero."""
    return apart(case, fine(case, left), fine(case))


@cache
def order(case: Case) -> tuple[str, ...]:
    """The terms as they are left out one after another: first what is zero, then what matters least."""
    return tuple(sorted(TERMS, key=lambda term: (in_explain(case, term), model_error(case, (term,)))))


def idle(case: Case) -> int:
    """How many terms are zero in the scene."""
    return sum(not in_explain(case, term) for term in TERMS)


def measured(case: Case, left: tuple[str, ...], rounds: int) -> dict[str, object]:
    """A model's row: see `cells`."""
    model = without(case, left)
    coarse = end(case, model)
    true, by = truth(case)
    whole, lean = timed(case, [without(case, ()), model], rounds)
    low, high = np.percentile(whole - lean, (10, 90))
    note = f"against {by}"
    if by == "exact":
        note += f"; small steps end {apart(case, fine(case), true):.1e} from it"
    return {
        "scene": case.name,
        "term": "+".join(left) or NOTHING,
        "in_explain": "in" if any(in_explain(case, term) for term in left) else "out",
        "error_model": model_error(case, left),
        "error_step": apart(case, coarse, fine(case, left)),
        "error": apart(case, coarse, true),
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
    `error_model`, `error_step` and `error` (at 240 Hz against "exact" where it serves, else against small
    steps); `ns_with`, `ns_without` (medians, ns a step), `ns_p10`, `ns_p90` (of what is saved); `note`.

    Args:
        quick: two scenes, few rounds, no greedy models.
        car: its body; without one the car's scenes are left out.
    """
    rounds = 5 if quick else ROUNDS
    found = []
    for case in cases(car):
        if quick and case.name not in QUICK:
            continue
        found.append((f"{case.name}/{NOTHING}", partial(measured, case, (), rounds)))
        for term in TERMS:
            found.append((f"{case.name}/{term}", partial(measured, case, (term,), rounds)))
        for k in range(max(2, idle(case)), 1 if quick else len(TERMS) + 1):
            found.append((f"{case.name}/greedy {k}", partial(_greedy, case, k, rounds)))
    return found


def _greedy(case: Case, k: int, rounds: int) -> dict[str, object]:
    return measured(case, order(case)[:k], rounds)


def least(rows: Sequence[dict], error: float) -> dict[str, tuple[str, ...]]:
    """Of each scene: the terms of the cheapest model whose error is at most so large.

    It has no term that is zero in the scene. Times are compared as ratios to the whole model's, which took
    turns with it.

    Args:
        rows: as `cells` makes them, numbers perhaps as text.
        error: of the model, in the limit of small steps.
    """
    answer = {}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        mine = [row for row in rows if row["scene"] == scene]
        zero = {row["term"] for row in mine if row["in_explain"] == "out"} & set(TERMS)
        good = [row for row in mine if float(row["error_model"]) <= error and zero <= left_out(row)]
        if good:
            best = min(good, key=lambda row: float(row["ns_without"]) / float(row["ns_with"]))
            answer[scene] = tuple(term for term in TERMS if term not in left_out(best))
    return answer


def left_out(row: dict) -> set[str]:
    """The terms that a row's model does without."""
    return set(row["term"].split("+")) - {NOTHING}
