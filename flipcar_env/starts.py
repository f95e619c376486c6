"""How episodes start. Each kind is drawn from the row's own random stream."""

import math
from functools import cache
from importlib.resources import files

import numpy as np

from solver.algebra import entry, jit, matrix, put, to_body
from solver.model import store

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
    """(quat, height of the centre of mass, v, w) of a start; n is (key's halves, episode)."""
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
def _spread(value, share, u):
    """A value, more or less by a share of it, from u in [0, 1)."""
    return value * (1.0 + share * (2.0 * u - 1.0))


@jit
def _nominal_car(nominal, row):
    """Give the row the nominal car."""
    for j in range(nominal.shape[0]):
        row[r.CAR + j] = nominal[j]


@jit
def _draw_car(nominal, row, n):
    """Draw the row's car; n is (key's halves, episode)."""
    high, low, episode = n
    _nominal_car(nominal, row)
    mass = _spread(1.0, car.MASS_SPREAD, chance.uniform(high, low, episode, 40.0))
    row[r.MASS] *= mass
    for j in range(3):
        u = chance.uniform(high, low, episode, 41.0 + j)
        row[r.INERTIA + j] = mass * _spread(row[r.INERTIA + j], car.INERTIA_SPREAD, u)
        u = chance.uniform(high, low, episode, 44.0 + j)
        row[r.LIMIT + j] = _spread(row[r.LIMIT + j], car.LIMIT_SPREAD, u)
    # no axis may have more than the other two: then there would be negative mass somewhere
    for j in range(3):
        others = row[r.INERTIA + (j + 1) % 3] + row[r.INERTIA + (j + 2) % 3]
        row[r.INERTIA + j] = min(row[r.INERTIA + j], others)
    dx, dy, dz = car.OFFSET_SPREAD
    row[r.OFFSET] = chance.between(-dx, dx, high, low, episode, 47.0)
    row[r.OFFSET + 1] = chance.between(-dy, dy, high, low, episode, 48.0)
    row[r.OFFSET + 2] = chance.between(-dz, dz, high, low, episode, 49.0)
    least, most = car.FRICTION_RANGE
    row[r.FRICTION] = chance.between(least, most, high, low, episode, 50.0)
    least, most = car.RESTITUTION_RANGE
    row[r.RESTITUTION] = chance.between(least, most, high, low, episode, 51.0)


@entry
def begin(model, nominal, bank, rows, which, kinds, random):
    """Begin the next episode of some environments: draw its car and its start, and look at it.

    Args:
        model: what all rows share.
        nominal: the nominal car's columns of a row.
        bank: (2, n, 4) settled attitudes on the roof and on the side.
        rows: (n, row.width); KEY and EPISODE are read.
        which: (m,) their indices.
        kinds: (n,) indices into KINDS, or ANY.
        random: (n,) 1 to draw a car of its own, 0 for the nominal one.
    """
    hull = np.empty(((model.shape[0] - r.HULL) // 4, 4))
    for i in which:
        row = rows[i]
        row[r.EPISODE] += 1.0
        numbers = (row[r.KEY], row[r.KEY + 1], row[r.EPISODE])
        if random[i]:
            _draw_car(nominal, row, numbers)
        else:
            _nominal_car(nominal, row)
        task.place_hull(model, row, hull)
        kind = kinds[i]
        if kind == ANY:
            u = chance.uniform(row[r.KEY], row[r.KEY + 1], row[r.EPISODE], 0.0)
            kind = 0
            while kind < len(_CUMULATIVE) - 1 and u >= _CUMULATIVE[kind]:
                kind += 1
        quat, height, v, w = _pose(kind, hull, bank, numbers)
        store(row, (0.0, 0.0, height), quat, v, w)
        put(row, r.STEPS, (0.0, 0.0, 0.0))
        row[r.START] = kind
        for j in range(r.CLOSED, r.STATE):
            row[j] = 0.0
        task.look_at(model, row)


@cache
def settled() -> np.ndarray:
    """(2, n, 4) attitudes in which the car has come to rest on its roof and on its side.

    They come with the package, made by `python -m flipcar_env.settle`.
    """
    with np.load(str(files("flipcar_env") / "settled.npz"), allow_pickle=False) as data:
        bank = data["attitudes"]
    bank.setflags(write=False)
    return bank
