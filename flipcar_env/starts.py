"""How episodes start. Each kind is drawn from the row's own random stream."""

import math
from functools import cache

import numpy as np

from solver.algebra import entry, jit, matrix, put, put_quat, to_body
from solver.model import OPEN

from . import chance, task
from . import row as r

KINDS = ("roof", "side", "nose", "drop", "crash", "upright")

MIX = {"roof": 0.4, "side": 0.2, "nose": 0.1, "drop": 0.2, "upright": 0.1}
"""Start "any"."""

ANY = len(KINDS)
_ROOF, _SIDE, _NOSE, _DROP, _CRASH, _UPRIGHT = range(len(KINDS))
_CUMULATIVE = tuple(float(c) for c in np.cumsum([MIX.get(kind, 0.0) for kind in KINDS]))

NUDGE = 0.1
"""rad/s; spread of the small spin that a resting start is given, so that no two are alike."""

BANK = 64
"""Settled poses of each resting kind."""

_SETTLE_TIME = 12.0  # s
_STILL = 1e-3  # m/s and rad/s


@jit
def _euler(yaw, pitch, roll):
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
def _lowest(hull, quat):
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
    yaw = chance.between(-math.pi, math.pi, high, low, episode, 1)
    nudge = (
        NUDGE * chance.normal(high, low, episode, 2),
        NUDGE * chance.normal(high, low, episode, 4),
        NUDGE * chance.normal(high, low, episode, 6),
    )
    v = (0.0, 0.0, 0.0)
    if kind == _ROOF or kind == _SIDE:
        i = int(bank.shape[1] * chance.uniform(high, low, episode, 8))
        settled = bank[kind, i]
        c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        quat = (  # turned about the vertical
            c * settled[0] - s * settled[3],
            c * settled[1] - s * settled[2],
            c * settled[2] + s * settled[1],
            c * settled[3] + s * settled[0],
        )
        return quat, -_lowest(hull, quat), v, nudge
    if kind == _NOSE:
        # On the nose or the tail, let go near balance.
        side = 1.0 if chance.uniform(high, low, episode, 8) < 0.5 else -1.0
        pitch = side * 0.5 * math.pi + chance.between(-0.25, 0.25, high, low, episode, 9)
        quat = _euler(yaw, pitch, chance.between(-0.25, 0.25, high, low, episode, 10))
        return quat, -_lowest(hull, quat), v, nudge
    if kind == _DROP:
        # A uniform attitude is a normal 4-vector's direction.
        a = chance.normal(high, low, episode, 8)
        b = chance.normal(high, low, episode, 10)
        c = chance.normal(high, low, episode, 12)
        d = chance.normal(high, low, episode, 14)
        s = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
        quat = (a * s, b * s, c * s, d * s)
        v = (
            chance.normal(high, low, episode, 16),
            chance.normal(high, low, episode, 18),
            0.0,
        )
        w = (
            1.5 * chance.normal(high, low, episode, 20),
            1.5 * chance.normal(high, low, episode, 22),
            1.5 * chance.normal(high, low, episode, 24),
        )
        clear = chance.between(0.2, 1.5, high, low, episode, 26)
        return quat, clear - _lowest(hull, quat), v, w
    if kind == _CRASH:
        # Barrel rolling sideways: it travels to its left or right and rolls that way.
        roll = chance.between(-math.pi, math.pi, high, low, episode, 8)
        quat = _euler(yaw, chance.between(-0.3, 0.3, high, low, episode, 9), roll)
        speed = chance.between(5.0, 20.0, high, low, episode, 10)
        side = 1.0 if chance.uniform(high, low, episode, 11) < 0.5 else -1.0
        v = (-side * speed * math.sin(yaw), side * speed * math.cos(yaw), 0.0)
        spin = -side * speed * chance.between(0.2, 0.6, high, low, episode, 12)
        w = (spin + nudge[0], nudge[1], nudge[2])
        clear = chance.between(0.0, 0.5, high, low, episode, 13)
        return quat, clear - _lowest(hull, quat), v, w
    quat = _euler(yaw, 0.0, 0.0)
    return quat, -_lowest(hull, quat), v, nudge


@entry
def begin(model, bank, row, kind):
    """Draw a new start into a row, from the row's key and episode number.

    Args:
        model: what all rows share.
        bank: (2, n, 4) settled attitudes on the roof and on the side.
        row: to fill; KEY and EPISODE are read.
        kind: index into KINDS, or ANY.
    """
    hull = model[r.HULL :].reshape(-1, 4)
    numbers = (row[r.KEY], row[r.KEY + 1], row[r.EPISODE])
    if kind == ANY:
        u = chance.uniform(row[r.KEY], row[r.KEY + 1], row[r.EPISODE], 0)
        kind = 0
        while kind < len(_CUMULATIVE) - 1 and u >= _CUMULATIVE[kind]:
            kind += 1
    quat, height, v, w = _pose(kind, hull, bank, numbers)
    put(row, r.MOTION, (0.0, 0.0, height))
    put_quat(row, r.MOTION + 3, quat)
    put(row, r.MOTION + 7, v)
    put(row, r.MOTION + 10, w)
    put(row, r.STEPS, (0.0, 0.0, 0.0))
    row[r.START] = kind
    row[r.CONTACTS :] = OPEN


@entry
def _lay_down(model, row, kind, index):
    """Set the car down at rest, tilted at random about a kind's middle; it has yet to settle."""
    hull = model[r.HULL :].reshape(-1, 4)
    side = 1.0 if chance.uniform(0.0, kind, index, 0) < 0.5 else -1.0
    middle = math.pi if kind == _ROOF else 0.5 * math.pi
    roll = side * middle + chance.between(-0.6, 0.6, 0.0, kind, index, 1)
    quat = _euler(0.0, chance.between(-0.4, 0.4, 0.0, kind, index, 2), roll)
    row[:] = 0.0
    put(row, r.MOTION, (0.0, 0.0, -_lowest(hull, quat)))
    put_quat(row, r.MOTION + 3, quat)


@cache
def settled_bank(packed_model: bytes) -> np.ndarray:
    """(2, BANK, 4) attitudes in which the car has come to rest on its roof and on its side.

    The car is set down at random tilts and left alone until it is still; it lies on the roof if it is
    still more than 120° from upright, on the side between 60° and 120°.

    Args:
        packed_model: the model's bytes (so that the bank is made once for each).
    """
    model = np.frombuffer(packed_model).copy()  # one that may be written to: else it compiles twice
    points = model[r.HULL :].size // 4
    bank = np.empty((2, BANK, 4))
    rows = np.zeros((1, r.width(points)))
    actions = np.zeros((1, 3), np.float32)
    for kind in (_ROOF, _SIDE):
        found, index = 0, 0
        while found < BANK:
            _lay_down(model, rows[0], kind, index)
            index += 1
            if index > 20 * BANK:
                raise RuntimeError(f"the car hardly ever settles on its {KINDS[kind]}")
            for _ in range(round(_SETTLE_TIME / model[r.CONTROL_DT])):
                task.step(model, rows, actions)
            motion = rows[0, r.MOTION : r.STEPS]
            cos_tilt = 1.0 - 2.0 * (motion[4] ** 2 + motion[5] ** 2)
            lies = cos_tilt < -0.5 if kind == _ROOF else abs(cos_tilt) < 0.5
            if lies and np.abs(motion[7:]).max() < _STILL:
                bank[kind, found] = motion[3:7]
                found += 1
    bank.setflags(write=False)
    return bank
