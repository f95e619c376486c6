"""Scenes whose answer is known: what each method's error is measured on.

Each is data: a scene, one or more starts, a duration, and a function from a trajectory to the error.
Lengths are in m, times in s. Bodies touch the ground with a box's corners or with spheres, so that every
engine can have the same ones.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from solver.body import Body
from solver.rotation import angle, from_vector, to_matrix
from solver.scene import Scene, State
from solver.surface import Plane

from . import restarts
from .engine import Trajectory
from .extended import ANSWERS

G = 9.81
ZERO = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Problem:
    """A scene with a known answer.

    Attributes:
        name: one word.
        title: a few.
        asks: what the error is, with its unit.
        source: of the answer.
        scene: the scene.
        starts: a batch, (k, ...).
        duration: s.
        records: equal intervals after each of which the trajectory is looked at.
        error: of a trajectory, >= 0.
        wrong: from this error on the answer is wrong altogether: the method has failed.
        torque: (records, 3) N m, body axes, or None.
        keeps: is the energy kept by the true motion?
    """

    name: str
    title: str
    asks: str
    source: str
    scene: Scene
    starts: State
    duration: float
    records: int
    error: Callable[[Trajectory], float]
    wrong: float = 0.5
    torque: np.ndarray | None = None
    keeps: bool = False


def one(x, quat=UPRIGHT, v=ZERO, w=ZERO) -> State:
    """A batch of one start."""
    return State(*(np.array(a, dtype=np.float64)[None] for a in (x, quat, v, w)))


def placed(scene: Scene, state: State) -> State:
    """The state moved along z, and its speed along z changed, so that the lowest point touches and stays."""
    x, v = state.x.copy(), state.v.copy()
    x[:, 2] -= scene.gap(state).min(axis=-1)
    k = scene.gap(state).argmin(axis=-1)
    v[:, 2] -= scene.contact(State(x, state.quat, v, state.w)).v[np.arange(len(x)), k]
    return State(x, state.quat, v, state.w)


# ------------------------------------------------------------------------- smooth motion of one point


def _spin() -> tuple[Scene, State]:
    body = Body(1.0, (1e-3, 2e-3, 2.5e-3), [ZERO], radius=0.05)
    return Scene(body, gravity=ZERO), one((0, 0, 1), w=(0.01, 10, 0.01))


def _top() -> tuple[Scene, State]:
    scene = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.09)], radius=0.01))
    return scene, placed(scene, one((0, 0, 0.1), w=(1, 0.5, 60)))


def _skid() -> tuple[Scene, State]:
    scene = Scene(Body(1.0, np.full(3, 0.004), [(0, 0, -0.02)], radius=0.1), friction=0.1)
    return scene, placed(scene, one((0, 0, 0.2), from_vector((0.6, 0, 0)), (1, 0.3, 0), (20, -5, 10)))


def _tippe() -> tuple[Scene, State]:
    R, m = 0.02, 0.02
    scene = Scene(Body(m, np.full(3, 0.4 * m * R**2), [(0, 0, 0.3 * R)], radius=R), friction=0.05)
    quat = from_vector((0.5, 0, 0))
    return scene, placed(scene, one((0, 0, R), quat, w=100 * to_matrix(quat)[:, 2]))


SMOOTH = {
    "spin": (*_spin(), 60.0, 3000),
    "top": (*_top(), 1.0, 300),
    "skid": (*_skid(), 0.5, 100),
}
"""name: (scene, start, duration, steps of the reference integration)."""
TIPPE = (*_tippe(), 4.0)
"""Scene, start, duration: slip and rolling alternate, so it is not smooth."""


@cache
def _answers() -> dict[str, np.ndarray]:
    return {name: np.array(y) for name, y in json.loads(ANSWERS.read_text()).items()}


def off(scene: Scene, state: State, x: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """How far states are from a pose: the larger of angle (rad) and distance over the body's radius."""
    distance = np.linalg.norm(state.x - x, axis=-1) / scene.body.bounding_radius
    return np.maximum(distance, angle(state.quat, quat))


def _stored(name: str, title: str, source: str, keeps: bool = False) -> Problem:
    scene, starts, duration = TIPPE if name == "tippe" else SMOOTH[name][:3]

    def error(run: Trajectory) -> float:
        y = _answers()[name]
        return float(off(scene, run.at(-1), y[:3], y[3:7])[0])

    return Problem(
        name,
        title,
        "pose at the end: the larger of the angle, rad, and the distance over the body's radius",
        source,
        scene,
        starts,
        duration,
        15,
        error,
        keeps=keeps,
    )


# ---------------------------------------------------------------------------------- in closed form


def _block() -> Problem:
    mu, speed, height = 0.3, 2.0, 0.1
    scene = Scene(Body.box(1.0, (0.2, 0.2, height)), friction=mu)
    stop = np.array([speed**2 / (2 * mu * G), 0, height / 2])

    def error(run: Trajectory) -> float:
        return float(np.linalg.norm(run.x[-1, 0] - stop) / stop[0])

    return Problem(
        "block",
        "a block slides to a stop",
        "distance from the right place over the way, v²/2μg",
        "closed form",
        scene,
        one((0, 0, height / 2), v=(speed, 0, 0)),
        1.0,
        10,
        error,
    )


def _roll() -> Problem:
    mu, speed, R, duration = 0.2, 2.0, 0.1, 1.0
    scene = Scene(Body.sphere(1.0, R), friction=mu)
    rolls = 2 * speed / (7 * mu * G)
    way = 12 * speed**2 / (49 * mu * G) + 5 / 7 * speed * (duration - rolls)

    def error(run: Trajectory) -> float:
        return float(np.linalg.norm(run.x[-1, 0] - [way, 0, R]) / way)

    return Problem(
        "roll",
        "a sphere slides, then rolls",
        "distance from the right place over the way",
        "closed form: rolls after 2v/7μg with 5v/7",
        scene,
        one((0, 0, R), v=(speed, 0, 0)),
        duration,
        10,
        error,
    )


def _slope() -> Problem:
    mu, duration = 0.8, 2.0
    theta = np.arctan(mu / 2)
    normal = np.array([np.sin(theta), 0, np.cos(theta)])
    scene = Scene(Body.box(1.0, (1.0, 1.0, 0.4)), Plane(normal), friction=mu)
    x = 0.2 * normal

    def error(run: Trajectory) -> float:
        half = len(run.t) // 2  # what soft contacts sink at first is not creep
        return float(np.linalg.norm(run.x[-1, 0] - run.x[half, 0]) / (run.t[-1] - run.t[half]))

    return Problem(
        "slope",
        "a box on a slope of half the friction angle",
        "creep in the second half, m/s",
        "it does not move",
        scene,
        one(x, from_vector((0, theta, 0))),
        duration,
        10,
        error,
        wrong=0.01,
    )


def _bounce() -> Problem:
    R, height = 0.1, 1.0
    scene = Scene(Body.sphere(1.0, R), restitution=1.0)

    def error(run: Trajectory) -> float:
        energy = G * (run.x[:, 0, 2] - R) + 0.5 * (run.v[:, 0] ** 2).sum(-1)
        return float(np.abs(energy / (G * height) - 1).max())

    return Problem(
        "bounce",
        "lossless bounces, 10 s",
        "largest error of the energy, relative",
        "the energy is kept",
        scene,
        one((0, 0, R + height)),
        10.0,
        30,
        error,
        keeps=True,
    )


def _ball() -> Problem:
    R, height, e, duration = 0.1, 1.0, 0.8, 5.0
    scene = Scene(Body.sphere(1.0, R), restitution=e)

    def true_height(t: float) -> float:
        first = np.sqrt(2 * height / G)
        if t < first:
            return R + height - G * t**2 / 2
        t, up = t - first, e * G * first
        if t >= 2 * up / G / (1 - e):
            return R
        while t >= 2 * up / G:
            t, up = t - 2 * up / G, e * up
        return R + up * t - G * t**2 / 2

    def error(run: Trajectory) -> float:
        true = np.array([true_height(t) for t in run.t])
        return float(np.abs(run.x[:, 0, 2] - true).max() / height)

    return Problem(
        "ball",
        "a ball with e = 0.8 bounces and comes to rest",
        "largest error of the height over the first one",
        "closed form: at rest after √(2h/g)(1 + e)/(1 − e)",
        scene,
        one((0, 0, R + height)),
        duration,
        30,
        error,
    )


def _garwin() -> Problem:
    R, mu, e, duration = 0.1, 0.3, 0.8, 0.4
    scene = Scene(Body.sphere(1.0, R), friction=mu, restitution=e)
    vx, vz, spin, z = 2.0, -3.0, 5.0, 0.5
    strikes = (vz + np.sqrt(vz**2 + 2 * G * (z - R))) / G
    v_n = vz - G * strikes
    P_t = -2 / 7 * (vx - R * spin)  # m = 1
    assert abs(P_t) < mu * (1 + e) * abs(v_n)  # so it sticks
    left = duration - strikes
    x = np.array(
        [vx * strikes + (vx + P_t) * left, 0, R - e * v_n * left - G * left**2 / 2],
    )
    turn = spin * strikes + (spin - R * P_t / (0.4 * R**2)) * left

    def error(run: Trajectory) -> float:
        return float(off(scene, run.at(-1), x, from_vector((0, turn, 0)))[0])

    return Problem(
        "garwin",
        "a spinning ball bounces once",
        "pose at the end: the larger of the angle, rad, and the distance over the radius",
        "closed form (Garwin 1969)",
        scene,
        one((0, 0, z), v=(vx, 0, vz), w=(0, spin, 0)),
        duration,
        3,
        error,
    )


def _rod() -> Problem:
    L, rho, e, theta, speed, duration = 1.0, 0.02, 0.5, 0.5, 2.0, 0.2
    J = 1.0 / 12 * L**2
    body = Body(1.0, (0.01 * J, J, J), [(-L / 2, 0, 0), (L / 2, 0, 0)], radius=rho)
    scene = Scene(body, gravity=ZERO, restitution=e)
    gap = 0.2137  # so that no step ends at the impact by chance
    z = rho + gap + L / 2 * np.sin(theta)
    strikes = gap / speed
    arm = L / 2 * np.cos(theta)  # turned about +y, the end at +x is the lower one
    P = (1 + e) * speed / (1 + arm**2 / J)
    x = np.array([0, 0, z - speed * strikes + (P - speed) * (duration - strikes)])
    turn = theta - arm * P / J * (duration - strikes)

    def error(run: Trajectory) -> float:
        return float(off(scene, run.at(-1), x, from_vector((0, turn, 0)))[0])

    return Problem(
        "rod",
        "a rod strikes with one end, without friction",
        "pose at the end: the larger of the angle, rad, and the distance over the radius",
        "closed form: P = (1 + e) m v / (1 + 3 cos²θ)",
        scene,
        one((0, 0, z), from_vector((0, theta, 0)), (0, 0, -speed)),
        duration,
        3,
        error,
    )


def _rocking() -> Problem:
    b, h, duration = 0.1, 0.3, 0.6
    alpha = np.arctan2(b, h)
    p2 = 0.75 * G / np.hypot(b, h)
    scene = Scene(Body.box(1.0, (2 * b, 0.2, 2 * h)), friction=5.0)
    quat = from_vector((0, 0.5 * alpha, 0))

    @cache
    def tilt() -> float:
        from scipy.integrate import solve_ivp

        def rocks(t, y):
            return [y[1], -p2 * np.sin(alpha - y[0])]

        def upright(t, y):
            return y[0]

        vars(upright).update(terminal=True, direction=-1)
        options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
        falls = solve_ivp(rocks, (0, duration), [0.5 * alpha, 0], events=upright, **options)
        rate = -falls.y[1, -1] * (1 - 1.5 * np.sin(alpha) ** 2)
        return -solve_ivp(rocks, (falls.t[-1], duration), [0, rate], **options).y[0, -1]

    def error(run: Trajectory) -> float:
        return float(angle(run.quat[-1, 0], from_vector((0, tilt(), 0))))

    return Problem(
        "rocking",
        "a block rocks over from one edge to the other",
        "tilt at the end, rad",
        "Housner's equation and energy ratio (1963)",
        scene,
        one(-to_matrix(quat) @ [b, 0, -h], quat),
        duration,
        6,
        error,
        wrong=0.1,
    )


def _restart(restart: restarts.Restarts) -> Problem:
    def error(run: Trajectory) -> float:
        return float(np.median(restarts.error(restart, run.at(-1))))

    return Problem(
        restart.name,
        restart.title,
        "pose after half a second, median of restarts: √(angle² + (distance over the radius)²)",
        '"exact", certified by an independent integration',
        restart.scene,
        restart.starts,
        restart.duration,
        restart.records,
        error,
        torque=restart.torque,
    )


@cache
def problems() -> dict[str, Problem]:
    """All of them, by name."""
    extended = "integration of order 16 in extended precision"
    every = [
        _stored("spin", "a free spin that turns over, 60 s", extended, keeps=True),
        _stored("top", "a lopsided top on a frictionless tip", extended, keeps=True),
        _stored("skid", "an off-centre sphere skids in a curve", extended),
        _stored(
            "tippe", "a tippe top turns over", '"exact" at its finest (an independent integration: to 2e-5)'
        ),
        _block(),
        _roll(),
        _slope(),
        _bounce(),
        _ball(),
        _garwin(),
        _rod(),
        _rocking(),
        *map(_restart, restarts.problems()),
    ]
    return {problem.name: problem for problem in every}
