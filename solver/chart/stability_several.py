"""Scenes of the stability map on several points: how each is built and judged."""

from collections.abc import Sequence

import numpy as np

from solver.body import Body
from solver.chart.engine import Trajectory
from solver.chart.stability_case import (
    COARSEST,
    UPRIGHT,
    ZERO,
    Set,
    energy,
    g,
    gains,
    gaps,
    moved,
    near,
    rebound,
    starts,
    whole,
)
from solver.rotation import from_vector, product, to_matrix
from solver.scene import Scene, State
from solver.surface import Plane


def column(slenderness: float) -> Set:
    """Standing."""
    body = Body.box(1.0, (0.1, 0.12, 0.1 * slenderness))
    start = starts([(0, 0, 0.05 * slenderness), UPRIGHT, ZERO, ZERO])
    return Scene(body, friction=0.5), start, 10.0


def stays(scene: Scene, run: Trajectory) -> bool:
    """Within a millimetre, and no energy gained: m g times that."""
    up = -run.x @ scene.gravity
    return moved(scene, run).max() < 1e-3 and not gains(scene, run, 0.1 * g) and np.ptp(up) < 1e-3 * g


def slope(fraction: float) -> Set:
    """A block at tanθ = fraction μ."""
    theta = np.arctan(0.5 * fraction)
    normal = np.array([np.sin(theta), 0.0, np.cos(theta)])
    scene = Scene(Body.box(1.0, (1.0, 1.0, 0.4)), Plane(normal), friction=0.5)
    return scene, starts([0.2 * normal, from_vector((0, theta, 0)), ZERO, ZERO]), 10.0


def creeps_not(scene: Scene, run: Trajectory) -> bool:
    """Within a millimetre."""
    return moved(scene, run).max() < 1e-3


THROWN_AT, THROWN_ON = 0.35, 0.3
"""rad from x; μ."""


def throw(speed: float) -> Set:
    """A flat block along the ground."""
    v = speed * np.array([np.cos(THROWN_AT), np.sin(THROWN_AT), 0.0])
    scene = Scene(Body.box(1.0, (0.4, 0.4, 0.1)), friction=THROWN_ON)
    return scene, starts([(0, 0, 0.05), UPRIGHT, v, ZERO]), whole(speed / (THROWN_ON * g) + 0.5)


def stops_there(scene: Scene, run: Trajectory) -> bool:
    """After v²/2μg, in the direction of the throw, and still."""
    x, speed = run.x[-1, 0], np.linalg.norm(run.v[0, 0])
    far = np.hypot(x[0], x[1])
    straight = abs(np.arctan2(x[1], x[0]) - THROWN_AT) < 0.05
    return near(far, speed**2 / (2.0 * THROWN_ON * g)) and straight and np.abs(run.v[-1]).max() < 0.01


DROP, BASE = 0.5, (0.2, 0.25)
"""m: about how far, and the base of the box that is to stand."""


def box_drop(size: Sequence[float], e: float) -> Set:
    """Flat, from three heights at three bearings."""
    rows = [
        [(0, 0, size[2] / 2 + height), from_vector((0, 0, bearing)), ZERO, ZERO]
        for height, bearing in ((DROP, 0.0), (1.06 * DROP, 0.3), (1.14 * DROP, 0.7))
    ]
    return (
        Scene(Body.box(1.0, size), friction=0.5, restitution=e),
        starts(*rows),
        whole(1.0 if e == 0.0 else 0.7),
    )


def lands(scene: Scene, run: Trajectory) -> bool:
    """The rebound is e² of the drop; with e = 0 it also stands still then."""
    half = scene.body.hull[:, 2].max()
    drop = run.x[0, :, 2] - half
    up = rebound(run) - half
    if scene.restitution == 0.0:
        return bool((up < 0.01 * drop).all()) and np.abs(run.v[-1]).max() < 0.05
    return near(up, scene.restitution**2 * drop, drop.min())


def overlap(mm: float) -> Set:
    """A box of 40 cm, so deep in the ground."""
    scene = Scene(Body.box(1.0, (0.4, 0.3, 0.4)), friction=0.5)
    return scene, starts([(0, 0, 0.2 - 1e-3 * mm), UPRIGHT, ZERO, ZERO]), 2.0


def comes_out(scene: Scene, run: Trajectory) -> bool:
    """No higher above the ground than it was below it; on the ground at the end, within a millimetre."""
    gap = gaps(scene, run).min(axis=2)
    return gap.max() <= -gap[0, 0] and abs(gap[-1, 0]) < 1e-3


def corner(rate: float) -> Set:
    """A box that spins fast, thrown down at 10 m/s."""
    scene = Scene(Body.box(1.0, (0.1, 0.2, 0.3)), friction=0.5)
    w = rate * np.array([800.0, 400.0, 450.0]) / np.linalg.norm([800.0, 400.0, 450.0])
    rows = [[(0, 0, 1), from_vector((angle, 0, 0)), (0, 0, -10), w] for angle in (0.3, 1.0, 2.0)]
    return scene, starts(*rows), whole(0.3)


def outside(scene: Scene, run: Trajectory) -> bool:
    """Never a centimetre deep, and no gain."""
    return gaps(scene, run).min() > -0.01 and not gains(scene, run, energy(scene, run)[0].max())


DIP, HALF_ROD = 1e-3, 0.5


def passing(rate: float) -> float:
    """When the first end of the rod is lowest, s: at the end of a step of any length that divides it.

    The other end has not passed before, if a step of 1/240 s allows that.
    """
    return 2.0 ** np.clip(np.floor(np.log2(240.0 * np.pi / rate)), 0.0, 4.0) / 240.0


def dip(rate: float) -> Set:
    """A rod spinning in place. A step's end finds it a microsecond past its lowest, no longer closing."""
    scene = Scene(Body.rod(1.0, 2 * HALF_ROD), gravity=ZERO)
    quat = from_vector((0, np.pi / 2 - rate * (passing(rate) - 1e-6), 0))
    return scene, starts([(0, 0, HALF_ROD - DIP), quat, ZERO, (0, rate, 0)]), 2 / COARSEST


def is_seen(scene: Scene, run: Trajectory) -> bool:
    """It moves up before the other end comes round; one record is always looked at."""
    rate = run.w[0, 0, 1]
    after = run.t > passing(rate) - 1e-9
    before = after & (run.t < passing(rate) + np.pi / rate)
    before[after.argmax()] = True
    return bool((run.v[before, 0, 2] > 0.0).any())


def housner(slenderness: float) -> tuple[float, float, float]:
    """Of a block of half width 0.1 m: the tilt it starts at, its quarter period, r (Housner 1963)."""
    R, alpha = 0.1 * np.hypot(1.0, slenderness), np.arctan(1.0 / slenderness)
    p2, tilt = 0.75 * g / R, 0.5 * alpha
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s = 0.5 * np.sqrt(tilt) * (nodes + 1.0)  # θ = tilt − s²: smooth
    speed = np.sqrt(2.0 * p2 * np.sin(alpha - tilt + s**2 / 2.0) * np.sinc(s**2 / 2.0 / np.pi))
    quarter = 0.5 * np.sqrt(tilt) * (weights * 2.0 / speed).sum()
    return tilt, float(quarter), float((1.0 - 1.5 * np.sin(alpha) ** 2) ** 2)


def rocking(slenderness: float) -> Set:
    """Housner's block, let go at half the angle at which it would topple."""
    tilt, quarter, _r = housner(slenderness)
    quat = from_vector((0, tilt, 0))
    x = -to_matrix(quat) @ [0.1, 0.0, -0.1 * slenderness]
    scene = Scene(Body.box(1.0, (0.2, 0.2, 0.2 * slenderness)), friction=2.0)
    return scene, starts([x, quat, ZERO, ZERO]), whole(1.6 * quarter)


def rocks(scene: Scene, run: Trajectory) -> bool:
    """The first impact is in time, and leaves Housner's part of the energy."""
    high = scene.body.hull[:, 2].max()
    _tilt, quarter, r = housner(high / 0.1)
    over = np.flatnonzero(2.0 * run.quat[:, 0, 2] * run.quat[:, 0, 0] <= 0.0)
    if len(over) == 0:
        return False
    E = energy(scene, run)[:, 0] - scene.body.m * g * high
    step = run.t[1]
    return near(run.t[over[0]] - 0.5 * step, quarter, 50.0 * step) and near(E[-1] / E[0], r)


def edge(tip: float) -> Set:
    """A box that tips over about its edge, one end a fraction of a micrometre higher."""
    scene = Scene(Body.box(1.0, (0.2, 0.6, 0.2)))
    quat = product(from_vector((1e-6, 0, 0)), from_vector((0, tip, 0)))
    z = -scene.gap(State(ZERO, quat, ZERO, ZERO)).min()
    return scene, starts([(0, 0, z), quat, ZERO, ZERO]), whole(0.2)


def evenly(scene: Scene, run: Trajectory) -> bool:
    """Neither end is ever lifted: it turns about the edge alone."""
    return np.abs(run.w[:, :, [0, 2]]).max() < 0.01 and np.abs(gaps(scene, run).min(axis=2)).max() < 1e-3


ROD = Body.rod(1.0, 1.0)


def strike(mu: float) -> Set:
    """A rod at 45° meets the ground with e = 1, in a dozen directions; without gravity."""
    quat = from_vector((0, np.pi / 4, 0))
    z = 0.5 * np.sin(np.pi / 4) + 1e-3
    slips = np.linspace(0.2, np.pi - 0.2, 12)
    rows = [[(0, 0, z), quat, (np.cos(a), 0, -np.sin(a)), ZERO] for a in slips]
    return Scene(ROD, gravity=ZERO, friction=mu, restitution=1.0), starts(*rows), 1 / COARSEST


def gains_nothing(scene: Scene, run: Trajectory) -> bool:
    """And is not deep."""
    return gaps(scene, run).min() > -0.01 and not gains(scene, run, energy(scene, run)[0].max())


LEAN = np.arctan(2.0)
"""Of Painlevé's rod: the paradox begins at μ = (tan²θ + 4)/(3 tanθ) = 4/3, the least there is."""


def painleve(mu: float) -> Set:
    """A rod that slides on its lower end."""
    start = [(0, 0, 0.5 * np.sin(LEAN)), from_vector((0, LEAN, 0)), (1, 0, 0), ZERO]
    return Scene(ROD, friction=mu), starts(start), 3 / COARSEST


def rod_slope(fraction: float) -> Set:
    """A rod falls on a slope of tanθ = fraction μ, at an angle to it."""
    theta = np.arctan(0.5 * fraction)
    normal = np.array([np.sin(theta), 0.0, np.cos(theta)])
    quat = from_vector((0, theta + 0.2, 0))
    return Scene(ROD, Plane(normal), friction=0.5), starts([0.2 * normal, quat, ZERO, ZERO]), 5.0


def comes_to_lie(scene: Scene, run: Trajectory) -> bool:
    """Still within a millimetre in the last second; not deep before, and no gain."""
    last = run.x[run.t > run.t[-1] - 1.0]
    still = np.ptp(last, axis=0).max() < 1e-3
    gap = gaps(scene, run)
    return still and gap.min() > -0.01 and np.abs(gap[-1]).max() < 1e-3 and not gains(scene, run, 0.1 * g)
