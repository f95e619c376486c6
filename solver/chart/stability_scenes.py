"""The scenes of the stability map: each asks one yes-or-no question of whatever plays it.

Tolerances are loose, mostly 10 %: the question is whether the answer is of the right kind. How accurate
it is, others measure. A batch of a few starts that differ a little keeps luck out: all must be right.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from solver.body import Body
from solver.chart.engine import Trajectory
from solver.chart.naive import turned
from solver.rotation import product, to_matrix
from solver.scene import Scene, State
from solver.surface import Plane

g = 9.81
ZERO = np.zeros(3)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
COARSEST = 15
"""Hz; each duration is a whole number of the largest steps."""

Set = tuple[Scene, State, float]
"""A scene, a batch of starts in it, and for how long, s."""


@dataclass(frozen=True)
class Case:
    """A scene of the map.

    Attributes:
        name: as in the rows.
        asked: what `right` asks, in a sentence.
        varied: the parameter's name.
        unit: of the parameter, or "".
        values: of the parameter, from the easiest to the hardest; just one: only the step is varied.
        nominal: the value at which the step is varied.
        build: value to scene, starts and duration.
        right: whether a trajectory is of the right kind.
        rate: records a second, unless the step is longer.
    """

    name: str
    asked: str
    varied: str
    unit: str
    values: tuple[float, ...]
    nominal: float
    build: Callable[[float], Set]
    right: Callable[[Scene, Trajectory], bool]
    rate: int = 240


# ------------------------------------------------------------------------------------- what judges use


def starts(*rows: Sequence) -> State:
    """A batch of (x, quat, v, w)."""
    return State(*(np.array([row[i] for row in rows], dtype=float) for i in range(4)))


def about(axis: Sequence[float], angle: float) -> np.ndarray:
    """The attitude after a turn about an axis (unit length)."""
    return turned(UPRIGHT, np.array(axis, dtype=float), angle)


def whole(seconds: float) -> float:
    """Rounded up to a whole number of the largest steps."""
    return ceil(COARSEST * seconds - 1e-9) / COARSEST


def states(run: Trajectory) -> State:
    """All records of all starts as one batch, quaternions of unit length."""
    quat = run.quat.reshape(-1, 4)
    quat = quat / np.linalg.norm(quat, axis=1, keepdims=True)
    return State(run.x.reshape(-1, 3), quat, run.v.reshape(-1, 3), run.w.reshape(-1, 3))


def energy(scene: Scene, run: Trajectory) -> np.ndarray:
    """(T, k) J."""
    return np.reshape(scene.energy(states(run)), run.x.shape[:2])


def gaps(scene: Scene, run: Trajectory) -> np.ndarray:
    """(T, k, p) m."""
    return scene.gap(states(run)).reshape(*run.x.shape[:2], -1)


def moved(scene: Scene, run: Trajectory) -> np.ndarray:
    """(T, k) m: how far any hull point is from where it was at first."""
    state = states(run)
    points = state.x[:, None] + np.einsum("nij,pj->npi", to_matrix(state.quat), scene.body.hull)
    points = points.reshape(*run.x.shape[:2], -1, 3)
    return np.linalg.norm(points - points[0], axis=-1).max(axis=-1)


def gains(scene: Scene, run: Trajectory, scale: float) -> bool:
    """Whether the energy is ever above the first by more than a hundredth of `scale` (J)."""
    E = energy(scene, run)
    return bool((E > E[0] + 0.01 * scale).any())


def rebound(run: Trajectory) -> np.ndarray:
    """(k,) m: how high the centre of mass goes above its last place after something first slows its fall."""
    z, v = run.x[:, :, 2], run.v[:, :, 2]
    met = np.maximum.accumulate(np.diff(v, axis=0, prepend=v[:1]) > 0.0, axis=0)
    apex = z + np.maximum(v, 0.0) ** 2 / (2.0 * g)
    return np.where(met, apex, -np.inf).max(axis=0)


def near(value: Any, answer: Any, scale: float = 0.0) -> bool:
    """Within 10 % of the answer, or a hundredth of the scale."""
    return bool((np.abs(value - answer) <= np.maximum(0.1 * np.abs(answer), 0.01 * scale)).all())


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
UPWARD = (0.123, -0.517, 0.311)
"""m/s: dropped from rest, a bounce may fall together with a step's end for ever."""


def ball(e: float, seconds: float) -> Set:
    """Thrown so that it would rise to about a metre."""
    heights = (0.999, 1.016, 0.975)
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
    quat = about((1, 0, 0), TOP_TILT)
    w = np.array([0, 0, precession(s)]) + s * to_matrix(quat)[:, 2]
    return Scene(body), starts([(0, 0, TOP_l * np.cos(TOP_TILT) + 0.01), quat, ZERO, w]), 4.0


def precesses(scene: Scene, run: Trajectory) -> bool:
    """Tip on the ground, tilt kept."""
    z = run.x[:, :, 2] - 0.01
    return np.abs(gaps(scene, run)).max() < 1e-3 and bool((np.abs(z / z[0] - 1.0) < 0.1).all())


def tippe(spin: float) -> Set:
    """A sphere whose centre of mass is off its centre, spun about its axis."""
    R, m = 0.02, 0.02
    off, quat = 0.3 * R, about((1, 0, 0), 0.5)
    axis = to_matrix(quat)[:, 2]
    body = Body(m, np.full(3, 0.4 * m * R**2), [(0, 0, off)], radius=R)
    return Scene(body, friction=0.05), starts([(0, 0, R - off * axis[2]), quat, ZERO, spin * axis]), 6.0


def turns_over(scene: Scene, run: Trajectory) -> bool:
    """Its axis is below the horizontal at the end, and was not before 3 s."""
    up = to_matrix(states(run).quat)[:, 2, 2].reshape(run.x.shape[:2])
    return bool((up[-1] < 0.0).all() and (up[run.t < 3.0] > 0.0).all())


# ---------------------------------------------------------------------------------------- several points


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
    return scene, starts([0.2 * normal, about((0, 1, 0), theta), ZERO, ZERO]), 10.0


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
        [(0, 0, size[2] / 2 + height), about((0, 0, 1), bearing), ZERO, ZERO]
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
    scene = Scene(Body.box(1.0, (0.1, 0.2, 0.3)), friction=0.5, restitution=0.5)
    w = rate * np.array([800.0, 400.0, 450.0]) / np.linalg.norm([800.0, 400.0, 450.0])
    rows = [[(0, 0, 1), about((1, 0, 0), angle), (0, 0, -10), w] for angle in (0.3, 1.0, 2.0)]
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
    scene = Scene(Body.rod(1.0, 2 * HALF_ROD), gravity=ZERO, restitution=0.5)
    quat = about((0, 1, 0), np.pi / 2 - rate * (passing(rate) - 1e-6))
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
    quat = about((0, 1, 0), tilt)
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
    quat = product(about((1, 0, 0), 1e-6), about((0, 1, 0), tip))
    z = -scene.gap(State(ZERO, quat, ZERO, ZERO)).min()
    return scene, starts([(0, 0, z), quat, ZERO, ZERO]), whole(0.2)


def evenly(scene: Scene, run: Trajectory) -> bool:
    """Neither end is ever lifted: it turns about the edge alone."""
    return np.abs(run.w[:, :, [0, 2]]).max() < 0.01 and np.abs(gaps(scene, run).min(axis=2)).max() < 1e-3


ROD = Body.rod(1.0, 1.0)


def strike(mu: float) -> Set:
    """A rod at 45° meets the ground with e = 1, in a dozen directions; without gravity."""
    quat = about((0, 1, 0), np.pi / 4)
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
    start = [(0, 0, 0.5 * np.sin(LEAN)), about((0, 1, 0), LEAN), (1, 0, 0), ZERO]
    return Scene(ROD, friction=mu), starts(start), 3 / COARSEST


def rod_slope(fraction: float) -> Set:
    """A rod falls on a slope of tanθ = fraction μ, at an angle to it."""
    theta = np.arctan(0.5 * fraction)
    normal = np.array([np.sin(theta), 0.0, np.cos(theta)])
    quat = about((0, 1, 0), theta + 0.2)
    return Scene(ROD, Plane(normal), friction=0.5), starts([0.2 * normal, quat, ZERO, ZERO]), 5.0


def comes_to_lie(scene: Scene, run: Trajectory) -> bool:
    """Still within a millimetre in the last second; not deep before, and no gain."""
    last = run.x[run.t > run.t[-1] - 1.0]
    still = np.ptp(last, axis=0).max() < 1e-3
    gap = gaps(scene, run)
    return still and gap.min() > -0.01 and np.abs(gap[-1]).max() < 1e-3 and not gains(scene, run, 0.1 * g)


# -------------------------------------------------------------------------------------------- all of them

CASES = (
    Case(
        "free-spin", "Turning over and over for 60 s: is the energy within 10 % all the time?",
        "spin", "rad/s", (1, 3, 10, 30, 100, 300, 1000), 10, spin, keeps_energy, 60,
    ),
    Case(
        "slender-spin", "A coning body for 10 s: are energy and quaternion's length within 10 %?",
        "inertia ratio", "", (2, 5, 10, 30, 100, 300, 1000), 10, slender, keeps_energy, 60,
    ),
    Case(
        "lossless-bounce", "A ball with e = 1: does it come as high as it was dropped from, within 10 %?",
        "time", "s", (1, 3, 5, 10, 20, 60), 20, lambda T: ball(1.0, T), bounces_on,
    ),
    Case(
        "settling-ball", "Is the first rebound e² of the drop within 10 %, and is it at rest in time?",
        "restitution", "", (0.3, 0.5, 0.7, 0.8, 0.9, 0.95), 0.8,
        lambda e: ball(e, 1.2 * rest_after(e) + 0.5), settles,
    ),
    Case(
        "bullet", "A 5 cm ball is shot down: never deeper than its radius, and lying there at the end?",
        "speed", "m/s", (1, 3, 10, 30, 100, 300), 30, bullet, stopped,
    ),
    Case(
        "top", "A top on a frictionless tip for 4 s: tip within 1 mm of the ground, height within 10 %?",
        "spin", "rad/s", (10, 30, 100, 300, 1000), 30, top, precesses,
    ),
    Case(
        "tippe-top", "Does the tippe top, which turns over after 4 s, do so between 3 and 6 s?",
        "spin", "rad/s", (100,), 100, tippe, turns_over,
    ),
    Case(
        "standing-column", "For 10 s: does no corner move by 1 mm, and is no energy gained?",
        "slenderness", "", (1, 2, 5, 10, 20, 50, 100), 5, column, stays, 15,
    ),
    Case(
        "slope", "A block inside the friction cone: does it creep less than 1 mm in 10 s?",
        "slope", "of μ", (0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99), 0.5, slope, creeps_not, 15,
    ),
    Case(
        "throw", "A block slides: does it stop where v²/2μg says within 10 %, within 3° of the throw?",
        "speed", "m/s", (1, 3, 10, 30, 100), 3, throw, stops_there, 60,
    ),
    Case(
        "flat-landing", "A box lands flat, e = 0: is the rebound below 1 % of the drop, and it stands?",
        "slenderness", "", (1, 2, 5, 10, 20), 2, lambda s: box_drop((*BASE, BASE[0] * s), 0.0), lands,
    ),
    Case(
        "flat-rebound", "A flat box lands flat: is the rebound e² of the drop, within 10 %?",
        "restitution", "", (0.1, 0.25, 0.5, 0.75, 1), 0.5, lambda e: box_drop((0.4, 0.3, 0.2), e), lands,
    ),
    Case(
        "overlap", "A box starts in the ground: does it come out, no higher than it was deep?",
        "depth", "mm", (0.1, 1, 3, 10), 10, overlap, comes_out,
    ),
    Case(
        "spinning-corner", "A spinning box hits the ground: never 1 cm deep, no energy gained?",
        "spin", "rad/s", (10, 30, 100, 300, 1000, 3000), 300, corner, outside,
    ),
    Case(
        "dip", "The end of a spinning rod dips 1 mm below the ground: is it thrown back?",
        "spin", "rad/s", (5, 10, 20, 40, 100, 300, 1000), 40, dip, is_seen,
    ),
    Case(
        "rocking", "Housner's block: first impact in time and energy left by it, within 10 %?",
        "slenderness", "", (2, 3, 5, 10), 3, rocking, rocks,
    ),
    Case(
        "edge", "A box tips over about its edge: do both ends stay down, without chatter?",
        "tilt", "rad", (0.7,), 0.7, edge, evenly,
    ),
    Case(
        "rod-strike", "A 45° rod strikes with e = 1 in twelve directions: does none gain energy?",
        "friction", "", (0.1, 0.25, 0.5, 0.75, 1, 1.25, 1.5), 0.5, strike, gains_nothing,
    ),
    Case(
        "painleve-rod", "A rod slides on its end: does it go on, without energy gained or sinking 1 cm?",
        "friction", "", (0.3, 0.6, 1, 1.3, 1.6, 2, 3), 2, painleve, gains_nothing,
    ),
    Case(
        "rod-on-slope", "A rod falls on a slope: does it come to lie, without gaining energy or sinking?",
        "slope", "of μ", (0.1, 0.25, 0.5, 0.75, 0.9), 0.5, rod_slope, comes_to_lie,
    ),
)  # fmt: skip
