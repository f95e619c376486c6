"""Scenes of the stability map in flight, and on one point: how each is built and judged."""

import numpy as np

from solver.body import Body
from solver.chart.engine import Trajectory
from solver.chart.stability_case import (
    UPRIGHT,
    ZERO,
    Set,
    energy,
    g,
    gains,
    gaps,
    near,
    rebound,
    starts,
    states,
    whole,
)
from solver.rotation import from_vector, to_matrix
from solver.scene import Scene

# --------------------------------------------------------------------------------------------- in flight


def keeps_energy(scene: Scene, run: Trajectory) -> bool:
    """The energy, and the quaternion's length."""
    E = energy(scene, run)
    return near(E, E[0]) and near(np.linalg.norm(run.quat, axis=-1), 1.0)


def spin(rate: float) -> Set:
    """About the middle axis, a thousandth off it."""
    body = Body(1.0, (1e-3, 2e-3, 2.5e-3), [ZERO], radius=0.05)
    start = starts([(0, 0, 1), UPRIGHT, ZERO, rate * np.array([1e-3, 1.0, 1e-3])])
    return Scene(body, gravity=ZERO), start, 60.0


def slender(ratio: float) -> Set:
    """J₁/J₃ of a symmetric body that spins about its own axis and end over end."""
    body = Body(1.0, (1e-2, 1e-2, 1e-2 / ratio), [ZERO], radius=0.05)
    return Scene(body, gravity=ZERO), starts([(0, 0, 1), UPRIGHT, ZERO, (1, 0, 3)]), 10.0


# --------------------------------------------------------------------------------------------- one point


BALL = 0.1
"""m, radius."""
UPWARD = (0.123, -0.517)
"""m/s: dropped from rest, a bounce may fall together with a step's end for ever."""


def ball(e: float, seconds: float) -> Set:
    """Thrown so that it would rise to about a metre."""
    heights = (0.999, 1.016)
    rows = [[(0, 0, BALL + z), UPRIGHT, (0, 0, v), ZERO] for z, v in zip(heights, UPWARD, strict=True)]
    return Scene(Body.sphere(1.0, BALL), restitution=e), starts(*rows), whole(seconds)


def apex(run: Trajectory) -> np.ndarray:
    """(T, k) m: how high the ball's lower end would rise."""
    return run.x[:, :, 2] - BALL + run.v[:, :, 2] ** 2 / (2.0 * g)


def bounces_on(scene: Scene, run: Trajectory) -> bool:
    """Where it is a tenth of the height up, its apex is that of the start; and it still gets there."""
    height = apex(run)
    up = run.x[:, :, 2] - BALL > 0.1 * height[0]
    late = run.t > run.t[-1] - 1.0
    return near(np.where(up, height, height[0]), height[0]) and bool(up[late].any(axis=0).all())


def rest_after(e: float, height: float = 1.03) -> float:
    """√(2h/g)(1 + e)/(1 − e), s."""
    return np.sqrt(2.0 * height / g) * (1.0 + e) / (1.0 - e)


def settles(scene: Scene, run: Trajectory) -> bool:
    """The first rebound, and rest on the ground in time."""
    e = scene.restitution
    late = run.t > 1.2 * rest_after(e)
    slow = np.abs(run.v[late]).max() < 0.01
    on_it = np.abs(gaps(scene, run)[late]).max() < 0.01
    return near(rebound(run) - BALL, e**2 * apex(run)[0], 1.0) and slow and bool(on_it)


BULLET = 0.05
"""m, radius."""


def bullet(speed: float) -> Set:
    """A small ball, shot at the ground."""
    times = 0.2 + np.array([0.13, 0.37, 0.61, 0.89]) / 240.0
    rows = [[(0, 0, BULLET + speed * t + 0.5 * g * t * t), UPRIGHT, (0, 0, -speed), ZERO] for t in times]
    return Scene(Body.sphere(1.0, BULLET)), starts(*rows), whole(0.5)


def stopped(scene: Scene, run: Trajectory) -> bool:
    """Never deep, no gain, and it lies there."""
    gap = gaps(scene, run)
    E = energy(scene, run)
    there = np.abs(gap[-1]).max() < BULLET and np.abs(run.v[-1]).max() < 0.1
    return gap.min() > -BULLET and not gains(scene, run, E[0].max()) and bool(there)


TOP_J1, TOP_J3, TOP_l, TOP_TILT = 0.011, 0.02, 0.1, 0.5


def precession(s: float) -> float:
    """Ω of the top in slow steady precession, spinning with s: (J₁ − J₃)cosθ Ω² − J₃ s Ω + m g l = 0."""
    return float(max(np.roots([(TOP_J3 - TOP_J1) * np.cos(TOP_TILT), TOP_J3 * s, -g * TOP_l])))


def top(s: float) -> Set:
    """On a frictionless tip, in steady precession."""
    body = Body(1.0, (TOP_J1, TOP_J1, TOP_J3), [(0, 0, -TOP_l)], radius=0.01)
    quat = from_vector((TOP_TILT, 0, 0))
    w = np.array([0, 0, precession(s)]) + s * to_matrix(quat)[:, 2]
    return Scene(body), starts([(0, 0, TOP_l * np.cos(TOP_TILT) + 0.01), quat, ZERO, w]), 4.0


def precesses(scene: Scene, run: Trajectory) -> bool:
    """Tip on the ground, tilt kept."""
    z = run.x[:, :, 2] - 0.01
    return np.abs(gaps(scene, run)).max() < 1e-3 and bool((np.abs(z / z[0] - 1.0) < 0.1).all())


def tippe(spin: float) -> Set:
    """A sphere whose centre of mass is off its centre, spun about its axis."""
    R, m = 0.02, 0.02
    off, quat = 0.3 * R, from_vector((0.5, 0, 0))
    axis = to_matrix(quat)[:, 2]
    body = Body(m, np.full(3, 0.4 * m * R**2), [(0, 0, off)], radius=R)
    return Scene(body, friction=0.05), starts([(0, 0, R - off * axis[2]), quat, ZERO, spin * axis]), 6.0


def turns_over(scene: Scene, run: Trajectory) -> bool:
    """Its axis is below the horizontal at the end, and was not before 3 s."""
    up = to_matrix(states(run).quat)[:, 2, 2].reshape(run.x.shape[:2])
    return bool((up[-1] < 0.0).all() and (up[run.t < 3.0] > 0.0).all())
