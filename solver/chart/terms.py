"""What leaving each term out of the kernel of "impulse" saves, in scenes that do not need it.

`python -m solver.chart.terms` prints the table that `solver.terms.COST` keeps.
"""

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from solver.algebra import borrowed, entry, keep_alive, vec
from solver.body import Body
from solver.impulse import run, step
from solver.model import MEMORY, load, store, unpack
from solver.scene import Scene, State, to_kernel
from solver.surface import HeightField
from solver.sweep import WIDTH
from solver.terms import Law, full

STEPS = 2000
ROUNDS = 25
H = 1 / 240


def start(height: float, v: tuple, w: tuple) -> State:
    """Upright, so high."""
    return State(np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0, 0.0]), np.array(v), np.array(w))


@entry
def awake(body, hull, ground, law, a, torque, state, contacts, f, options, h, n):
    """`impulse.run` for a body at rest, without falling asleep."""
    what = unpack(body, ground)
    x, quat, v, w = load(state)
    rows, push = np.zeros((hull.shape[0], WIDTH)), np.zeros((hull.shape[0], 3))
    clear = 0.0
    for _ in range(n):
        x, quat, v, w, clear, _still = step(
            what[0], borrowed(hull), what[1], law, vec(a, 0), vec(torque, 0),
            x, quat, v, w, borrowed(contacts), borrowed(rows), borrowed(push), h, clear,
        )  # fmt: skip
    store(state, x, quat, v, w)
    keep_alive(rows, push)


def timed(scene: Scene, state: State, law: Law, bound: float | None = None, kernel: Callable = run) -> float:
    """ns a step; `bound` replaces the radius of the bounding sphere."""
    body, hull, ground, _law = scene.parameters
    body = body.copy()
    body[4] = body[4] if bound is None else bound
    row = to_kernel(scene.body, state)[0]
    memory, f = np.zeros((len(hull), MEMORY)), np.zeros(len(hull))
    none = np.zeros(1)
    before = perf_counter()
    kernel(body, hull, ground, law, scene.gravity, np.zeros(3), row, memory, f, none, H, STEPS)
    return 1e9 * (perf_counter() - before) / STEPS


def costs() -> dict[str, tuple[float, float]]:
    """Of each term: median ns a step with it and without; with and without take turns."""
    box, cube = Body.box(1.0, (0.3, 0.4, 0.5)), Body.box(1.0, (0.3, 0.3, 0.3))
    ball = Body(1.0, (3e-3, 4e-3, 5e-3), [(0.0, 0.0, -0.02)], radius=0.1)
    slides = start(0.25, (60, 0, 0), (0, 0, 0))
    rests = start(0.25, (0, 0, 0), (0, 0, 0))
    central = Body(1.0, (3e-3, 4e-3, 5e-3), [(0.0, 0.0, 0.0)], radius=0.12)
    rolls = start(0.12, (1, 0.2, 0), (1, 2, 3))
    flies = start(1e5, (0, 0, 0), (0.5, 0.3, 0.2))

    def left_out(scene: Scene, state: State, term: int) -> tuple[Callable, Callable]:
        law = full(scene.friction, scene.restitution)
        lean: Any = (*law[:term], None, *law[term + 1 :])
        return lambda: timed(scene, state, law), lambda: timed(scene, state, lean)

    rough = Scene(box, friction=0.5)
    law = full(0.5, 0.0)
    level = HeightField(np.zeros((2, 2)), 1000.0)
    pairs = {
        "friction": left_out(Scene(box), slides, 0),
        "restitution": left_out(rough, slides, 1),
        "gyroscopic": left_out(Scene(cube, friction=0.5), flies, 2),
        "centripetal": left_out(Scene(central, friction=0.5), rolls, 4),
        "sweep": left_out(Scene(ball, friction=0.5), rolls, 3),
        "curvature": (
            lambda: timed(Scene(ball, level, friction=0.5), rolls, law),
            lambda: timed(Scene(ball, friction=0.5), rolls, law),
        ),
        "contact work": (
            lambda: timed(rough, flies, law, bound=np.inf),
            lambda: timed(rough, flies, law),
        ),
        "steps at rest": (
            lambda: timed(rough, rests, law, kernel=awake),
            lambda: timed(rough, rests, law),
        ),
    }
    times: dict[str, list[tuple[float, float]]] = {term: [] for term in pairs}
    for n in range(ROUNDS + 1):
        for term, (with_it, without) in pairs.items():
            pair = with_it(), without()
            if n > 0:  # the first compiles
                times[term].append(pair)
    medians = {term: np.median(pairs, axis=0) for term, pairs in times.items()}
    return {term: (float(pair[0]), float(pair[1])) for term, pair in medians.items()}


if __name__ == "__main__":
    print(f"{'term':14}{'with':>8}{'without':>9}  ns a step")
    for term, (with_it, without) in costs().items():
        print(f"{term:14}{with_it:8.0f}{without:9.0f}")
