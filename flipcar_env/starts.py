"""How episodes start. Each kind is drawn from the row's own random stream."""

import math
from functools import cache
from importlib.resources import files

import numpy as np

from solver.algebra import axpy, entry, jit, matrix, product, put, scale, to_body, to_world
from solver.field import foot
from solver.model import gap_if_below, seen, store

from . import car, chance, task
from . import row as r

KINDS = ("roof", "side", "nose", "drop", "crash", "upright")

MIX = {"roof": 0.4, "side": 0.2, "nose": 0.1, "drop": 0.2, "upright": 0.1}
"""Start "any"."""

ANY = len(KINDS)
_ROOF, _SIDE, _NOSE, _DROP, _CRASH, _UPRIGHT = range(len(KINDS))
_CUMULATIVE = tuple(float(c) for c in np.cumsum([MIX.get(kind, 0.0) for kind in KINDS]))

NUDGE = 0.1
"""rad/s; spread of the small spin that a resting start is given, so that no two are alike."""

LIFTED, MAX_LIFTS = 1e-12, 60
"""m, and tries: a car is put onto curved ground so exactly."""


@jit
def euler(yaw, pitch, roll):
    """Quaternion that turns first by roll about x, then pitch about y, then yaw about z."""
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


@jit
def lowest(hull, quat):
    """Height of the lowest hull point above the centre of mass, m (negative)."""
    up = to_body(matrix(quat), (0.0, 0.0, 1.0))
    lowest = math.inf
    for k in range(hull.shape[0]):
        z = up[0] * hull[k, 0] + up[1] * hull[k, 1] + up[2] * hull[k, 2] - hull[k, 3]
        lowest = min(lowest, z)
    return lowest


@jit
def _pose(kind, hull, bank, n):
    """(quat, height of the centre of mass, v, w) of a start on level ground; n is (key's halves, episode)."""
    high, low, episode = n
    yaw = chance.between(-math.pi, math.pi, high, low, episode, 1.0)
    nudge = (
        NUDGE * chance.normal(high, low, episode, 2.0),
        NUDGE * chance.normal(high, low, episode, 4.0),
        NUDGE * chance.normal(high, low, episode, 6.0),
    )
    v = (0.0, 0.0, 0.0)
    if kind == _ROOF or kind == _SIDE:
        i = int(bank.shape[1] * chance.uniform(high, low, episode, 8.0))
        settled = bank[kind, i]
        c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        quat = (  # turned about the vertical
            c * settled[0] - s * settled[3],
            c * settled[1] - s * settled[2],
            c * settled[2] + s * settled[1],
            c * settled[3] + s * settled[0],
        )
        return quat, -lowest(hull, quat), v, nudge
    if kind == _NOSE:
        # On the nose or the tail, let go near balance.
        side = 1.0 if chance.uniform(high, low, episode, 8.0) < 0.5 else -1.0
        pitch = side * 0.5 * math.pi + chance.between(-0.25, 0.25, high, low, episode, 9.0)
        quat = euler(yaw, pitch, chance.between(-0.25, 0.25, high, low, episode, 10.0))
        return quat, -lowest(hull, quat), v, nudge
    if kind == _DROP:
        # A uniform attitude is a normal 4-vector's direction.
        a = chance.normal(high, low, episode, 8.0)
        b = chance.normal(high, low, episode, 10.0)
        c = chance.normal(high, low, episode, 12.0)
        d = chance.normal(high, low, episode, 14.0)
        s = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
        quat = (a * s, b * s, c * s, d * s)
        v = (
            chance.normal(high, low, episode, 16.0),
            chance.normal(high, low, episode, 18.0),
            0.0,
        )
        w = (
            1.5 * chance.normal(high, low, episode, 20.0),
            1.5 * chance.normal(high, low, episode, 22.0),
            1.5 * chance.normal(high, low, episode, 24.0),
        )
        clear = chance.between(0.2, 1.5, high, low, episode, 26.0)
        return quat, clear - lowest(hull, quat), v, w
    if kind == _CRASH:
        # Barrel rolling sideways: it travels to its left or right and rolls that way.
        roll = chance.between(-math.pi, math.pi, high, low, episode, 8.0)
        quat = euler(yaw, chance.between(-0.3, 0.3, high, low, episode, 9.0), roll)
        speed = chance.between(5.0, 20.0, high, low, episode, 10.0)
        side = 1.0 if chance.uniform(high, low, episode, 11.0) < 0.5 else -1.0
        v = (-side * speed * math.sin(yaw), side * speed * math.cos(yaw), 0.0)
        spin = -side * speed * chance.between(0.2, 0.6, high, low, episode, 12.0)
        w = (spin + nudge[0], nudge[1], nudge[2])
        clear = chance.between(0.0, 0.5, high, low, episode, 13.0)
        return quat, clear - lowest(hull, quat), v, w
    quat = euler(yaw, 0.0, 0.0)
    return quat, -lowest(hull, quat), v, nudge


@jit
def _scattered(model, ground, field, hull, pose, n):
    """A start on level ground, moved to somewhere near the origin, and turned with the ground there.

    Over a height field the car is then lifted until the deepest hull point's gap is what it was.

    Returns:
        (x, quat, v, w).
    """
    quat, height, v, w = pose
    high, low, episode = n
    far = model[r.SCATTER]
    dx = chance.between(-far, far, high, low, episode, 30.0)
    dy = chance.between(-far, far, high, low, episode, 31.0)
    clear = height + lowest(hull, quat)
    normal = ground[0]
    if field is None:
        x = axpy(dx, ground[1], scale(dy, ground[2]))
        x = axpy(height + ground[3], normal, x)
    else:
        _phi, normal, _hessian = foot(field, (dx, dy, ground[3]))
        x = (dx, dy, ground[3] + height)
    # the shortest turn from the vertical to the normal
    s = 1.0 / math.sqrt(2.0 * (1.0 + normal[2]))
    turn = (s * (1.0 + normal[2]), -s * normal[1], s * normal[0], 0.0)
    quat, v = product(turn, quat), to_world(matrix(turn), v)
    if field is not None:
        x = _lifted(ground, field, hull, x, quat, clear)
    return x, quat, v, w


@jit
def _lifted(ground, field, hull, x, quat, clear):
    """Where x is when the deepest hull point's gap is `clear`: from x straight up or down."""
    for _ in range(MAX_LIFTS):
        view = seen(ground, matrix(quat), x)
        deepest = math.inf
        for k in range(hull.shape[0]):
            deepest = min(deepest, gap_if_below(hull, k, ground, field, view, deepest))
        x = (x[0], x[1], x[2] + clear - deepest)
        if abs(clear - deepest) < LIFTED:
            break
    return x


@jit
def _draw_car(row, n):
    """Draw the row's car; n is (key's halves, episode)."""
    high, low, episode = n
    for k in range(len(car.NOMINAL)):
        least, most = car.RANGES[k, 0], car.RANGES[k, 1]
        row[r.CAR + k] = chance.between(least, most, high, low, episode, 40.0 + k)
    mass = row[r.MASS] / car.MASS
    for k in range(r.INERTIA, r.INERTIA + 3):
        row[k] *= mass
    # No mass, wherever it is, has more inertia about one axis than about the other two.
    for k in range(3):
        others = row[r.INERTIA + (k + 1) % 3] + row[r.INERTIA + (k + 2) % 3]
        row[r.INERTIA + k] = min(row[r.INERTIA + k], others)


@entry
def begin(model, field, bank, rows, which, kinds, random):
    """Begin the next episode of some environments on one ground: draw its car and its start, and look at it.

    Args:
        model: what they share.
        field: the ground's, or None for a plane.
        bank: (2, n, 4) settled attitudes on the roof and on the side.
        rows: (n, row.width); KEY and EPISODE are read.
        which: (m,) their indices.
        kinds: (n,) indices into KINDS, or ANY.
        random: (n,) 1 to draw a car of its own, 0 for the nominal one.
    """
    ground = task.ground_of(model, field)
    hull = np.empty(((model.shape[0] - r.HULL) // 4, 4))
    for i in which:
        row = rows[i]
        row[r.EPISODE] += 1.0
        numbers = (row[r.KEY], row[r.KEY + 1], row[r.EPISODE])
        if random[i]:
            _draw_car(row, numbers)
        else:
            for j in range(len(car.NOMINAL)):
                row[r.CAR + j] = car.NOMINAL[j]
        task.place_hull(model, row, hull)
        kind = kinds[i]
        if kind == ANY:
            u = chance.uniform(row[r.KEY], row[r.KEY + 1], row[r.EPISODE], 0.0)
            kind = 0
            while kind < len(_CUMULATIVE) - 1 and u >= _CUMULATIVE[kind]:
                kind += 1
        quat, height, v, w = _pose(kind, hull, bank, numbers)
        if model[r.SCATTER] == 0.0:
            store(row, (0.0, 0.0, height), quat, v, w)
        else:
            x, quat, v, w = _scattered(model, ground, ground[4], hull, (quat, height, v, w), numbers)
            store(row, x, quat, v, w)
        put(row, r.STEPS, (0.0, 0.0, 0.0))
        row[r.START] = kind
        for j in range(r.CLOSED, r.STATE):
            row[j] = 0.0
        task.look_at(model, ground, row)


@cache
def settled() -> np.ndarray:
    """(2, n, 4) attitudes in which the car has come to rest on its roof and on its side.

    They come with the package, made by `python -m flipcar_env.settle`.
    """
    with np.load(str(files("flipcar_env") / "settled.npz"), allow_pickle=False) as data:
        bank = data["attitudes"]
    bank.setflags(write=False)
    return bank
