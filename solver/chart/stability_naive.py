"""The methods of `solver.chart.naive` as engines: each for the scenes that it applies to."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solver.chart import naive
from solver.chart.engine import EngineError, Trajectory
from solver.rotation import from_vector, product, to_matrix
from solver.scene import Scene, State


class Pose(NamedTuple):
    """A state that nobody checks: naive methods leave what a state may be."""

    x: np.ndarray
    quat: np.ndarray
    v: np.ndarray
    w: np.ndarray


Step = Callable[[Scene, Pose, float], Pose | State]


class Naive:
    """A naive method as an engine; see `solver.chart.engine.Engine`.

    Args:
        name: as it stands in charts.
        cases: names of the scenes that it applies to.
        step: (scene, state, h) to the next state.
        finest: the most steps a second that are tried: it is slow.
    """

    version = "this"

    def __init__(self, name: str, cases: tuple[str, ...], step: Step, finest: int = 1920, **settings: object):
        self.name, self.cases, self.step, self.finest = name, cases, step, finest
        self.settings = settings

    def refuses(self, scene: Scene) -> str | None:
        """Nothing; `cases` says what it is for."""
        return None

    def play(self, scene, starts, duration, records, steps, torque=None) -> Trajectory:
        """As in `Engine`, without torque. The time it took is not measured."""
        h = duration / (records * steps)
        past = np.zeros((records + 1, len(starts.x), 13))
        with np.errstate(all="ignore"):
            for j, start in enumerate(zip(starts.x, starts.quat, starts.v, starts.w, strict=True)):
                state: Pose | State = Pose(*start)
                past[0, j] = np.concatenate(start)
                for n in range(records):
                    try:
                        for _ in range(steps):
                            state = self.step(scene, Pose(state.x, state.quat, state.v, state.w), h)
                    except ValueError as error:  # a State that is not finite
                        raise EngineError(f"{error} after {duration * n / records:.3g} s") from error
                    past[n + 1, j] = np.concatenate([state.x, state.quat, state.v, state.w])
        t = np.linspace(0.0, duration, records + 1)
        x, quat, v, w = np.split(past, [3, 7, 10], axis=2)
        return Trajectory(t, x, quat, v, w, np.nan)


def closed(scene: Scene, state: Pose) -> list[int]:
    """The hull points at or below the surface."""
    points = state.x + scene.body.hull @ to_matrix(state.quat).T
    return [int(k) for k in np.flatnonzero(scene.surface.distance(points) <= scene.body.radius)]


# --------------------------------------------------------------------------------------------- free spin


def spun(law: Callable) -> Step:
    """Euler's equations by a law of body rates, then the turn with the new ones."""

    def step(scene, state, h):
        R = to_matrix(state.quat)
        w = R @ law(np.diag(scene.body.J), R.T @ state.w, h)
        return Pose(state.x, product(from_vector(h * w), state.quat), state.v, w)

    return step


def fixed_length(scene, state, h):
    """L turned the other way in body axes, with its length."""
    J, R = np.diag(scene.body.J), to_matrix(state.quat)
    L_b = naive.fixed_length_spin(J, J * (R.T @ state.w), h)
    quat = product(from_vector(h * state.w), state.quat)
    return Pose(state.x, quat, state.v, to_matrix(quat) @ (L_b / J))


def lengthening(scene, state, h):
    """Of a symmetric top: its rates go round the axis with Ω = (J₃ − J₁) w₃/J₁, exactly; q by Euler."""
    J = np.diag(scene.body.J)
    w_b = to_matrix(state.quat / np.linalg.norm(state.quat)).T @ state.w
    quat = naive.euler_quat(state.quat, state.w, h)
    angle = (J[2] - J[0]) / J[0] * w_b[2] * h
    c, s = np.cos(angle), np.sin(angle)
    w_b = np.array([c * w_b[0] - s * w_b[1], s * w_b[0] + c * w_b[1], w_b[2]])
    return Pose(state.x, quat, state.v, to_matrix(quat / np.linalg.norm(quat)) @ w_b)


# ------------------------------------------------------------------------------------ contacts held down


def unstabilised(scene, state, h):
    """Eq. 6 alone."""
    return naive.unstabilised(scene, state, h)


def eq8(scene, state, h):
    """Eq. 8 with e = 0 at the closed points, every frame."""
    points = closed(scene, state)
    if not points:
        return naive.fly(state, state.v + h * scene.gravity, free(scene, state, h), h)
    return naive.eq8_every_frame(scene, state, points, h)


def free(scene: Scene, state: Pose, h: float) -> np.ndarray:
    """w after h seconds, by Euler's step."""
    J = to_matrix(state.quat) @ scene.body.J @ to_matrix(state.quat).T
    return state.w - h * np.linalg.solve(J, np.cross(state.w, J @ state.w))


BETA, SWEEPS = 0.2, 20
"""Of Baumgarte's β φ/h, and how often the closed points are swept."""


def pushed_out(scene, state, h):
    """Closed points swept to leave with −β φ/h, as engines for games do."""
    points = closed(scene, state)
    rows = naive.Rows(scene, state, points)
    v, w = rows.velocities(state, h, np.zeros(len(points)))
    phi, i = scene.gap(State(state.x, state.quat, v, w))[points], np.zeros(len(points))
    for _ in range(SWEEPS):
        for k in range(len(points)):
            speed = rows.W[k] @ np.concatenate([v, w])
            more = max(-i[k], naive.baumgarte_velocity(rows.G[k], phi[k], speed, BETA, h))
            i[k] += more
            jump = rows.inv_M @ (more * rows.W[k])
            v, w = v + jump[:3], w + jump[3:]
    return naive.fly(state, v, w, h)


def jacobi(scene, state, h):
    """Eq. 8 at all closed points, each as if alone."""
    points = closed(scene, state)
    state = Pose(state.x, state.quat, state.v + h * scene.gravity, state.w)
    after = naive.all_at_once(scene, state, points) if points else state
    return naive.fly(state, after.v, after.w, h)


def switched(scene, state, h):
    """Pulling forces switched off one at a time."""
    return naive.switching(scene, state, h)[0]


def tested_at_ends(scene, state, h):
    """Contact is looked for at step ends only."""
    return naive.at_step_ends(scene, state, h)


# ---------------------------------------------------------------------------------------------- friction


def skidding(scene, state, h):
    """A block that cannot tip, as a point mass: a scalar for each tangent."""
    K = np.eye(3) / scene.body.m
    u = state.v + h * scene.gravity
    u = u + K @ naive.scalar_friction(K, u, scene.friction)
    return naive.fly(state, u, state.w, h)


def regularised(scene, state, h):
    """The same block on a slope, with the v_s that settles in one step: μ g cosθ h."""
    N = scene.surface.normal
    weight = -scene.gravity @ N
    drag = naive.regularised_friction(state.v, weight, scene.friction, scene.friction * weight * h)
    return naive.fly(state, state.v + h * (scene.gravity + weight * N + drag), state.w, h)


def struck(law: Callable) -> Step:
    """Fly; then an impulse law at the lowest point if it is below the ground and closing."""

    def step(scene, state, h):
        state = naive.fly(state, state.v + h * scene.gravity, state.w, h)
        gap = scene.gap(state)
        k = int(gap.argmin())
        R = to_matrix(state.quat)
        q = R @ scene.body.hull[k]
        u = state.v + np.cross(state.w, q)
        if gap[k] > 0.0 or u[2] >= 0.0:
            return state
        inv_J = R @ np.linalg.inv(scene.body.J) @ R.T
        p = law(naive.effective(scene.body.m, inv_J, q), u, scene.friction, scene.restitution)
        return Pose(state.x, state.quat, state.v + p / scene.body.m, state.w + inv_J @ np.cross(q, p))

    return step


def sliding(scene, state, h):
    """A point that slides on the ground, by the force of Eq. 11, whatever its sign; then nothing else."""
    k = int(scene.gap(State(state.x, state.quat, state.v, state.w)).argmin())
    rows = naive.Rows(scene, state, [k])
    R = to_matrix(state.quat)
    q = R @ scene.body.hull[k]
    u = state.v + np.cross(state.w, q)
    a = rows.a
    if rows.l[0] < 0.0 and abs(u[0]) > 1e-3:
        s = np.array([np.sign(u[0]), 0.0, 0.0])
        inv_J = rows.inv_M[3:, 3:]
        f = naive.sliding_force(naive.effective(scene.body.m, inv_J, q), rows.l[0], scene.friction, s)
        F = f * (np.array([0.0, 0.0, 1.0]) - scene.friction * s)
        a = a + np.concatenate([F / scene.body.m, inv_J @ np.cross(q, F)])
    return naive.fly(state, state.v + h * a[:3], state.w + h * a[3:], h)


# ----------------------------------------------------------------------------------------------- bounces


def newton(scene, state, h):
    """A ball turned round in every step that finds it low and closing."""
    R = scene.body.radius[0]
    z, v = naive.newton_every_step(state.x[2] - R, state.v[2], h, scene.restitution, -scene.gravity[2])
    return Pose(np.array([0.0, 0.0, z + R]), state.quat, np.array([0.0, 0.0, v]), state.w)


def popped(scene, state, h):
    """A ball put on the ground when it is found below."""
    R = scene.body.radius[0]
    z, v = naive.popped_out(state.x[2] - R, state.v[2], h, -scene.gravity[2])
    return Pose(np.array([0.0, 0.0, z + R]), state.quat, np.array([0.0, 0.0, v]), state.w)


def no_restitution(law: Callable) -> Callable:
    """Of `naive.scalar_friction` and its like."""
    return lambda K, u, mu, e: law(K, u, mu)


SPINS, BALLS = ("free-spin", "slender-spin"), ("lossless-bounce", "settling-ball")

NAIVE = (
    Naive("explicit spin", SPINS, spun(naive.explicit_spin)),
    Naive("implicit spin", SPINS, spun(naive.implicit_spin)),
    Naive("fixed-length L", SPINS, fixed_length, 480),
    Naive("quaternion Euler", ("slender-spin",), lengthening),
    Naive("no stabilisation", ("top",), unstabilised),
    Naive("Newton's e every step", BALLS, newton, 7680),
    Naive("popped-out positions", ("lossless-bounce",), popped, 7680),
    Naive("Eq. 8 every frame", ("settling-ball", "rocking"), eq8, 480),
    Naive("tests at step ends", ("bullet", "dip"), tested_at_ends),
    Naive("Baumgarte β φ/h", ("overlap",), pushed_out, β=BETA),
    Naive("all contacts at once", ("flat-landing",), jacobi),
    Naive("switching f < 0 off", ("edge",), switched, 7680),
    Naive("scalar friction", ("throw",), skidding),
    Naive("scalar friction impact", ("rod-strike",), struck(naive.scalar_friction)),
    Naive("Newton's e, friction", ("rod-strike",), struck(naive.newton_impulse)),
    Naive("regularised friction", ("slope",), regularised),
    Naive("f = -l/G, friction", ("painleve-rod",), sliding),
)
