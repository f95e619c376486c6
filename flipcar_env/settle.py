"""Let the car settle on its roof and on its sides: `python -m flipcar_env.settle` makes the bank of starts.

It is made once and comes with the package, so that no start waits for it. Whoever changes the car makes it
again; a test compares fingerprints.
"""

import hashlib
import math
from pathlib import Path

import numpy as np

from solver.algebra import entry, put, put_quat

from . import car, chance, starts, task
from . import row as r
from .core import Core

BANK = 64
"""Settled poses of each kind."""

SETTLE_TIME = 12.0
"""s."""

STILL = 1e-3
"""m/s and rad/s."""

KINDS = ("roof", "side")
TILTS = {"roof": (120.0, 180.0), "side": (60.0, 120.0)}
"""degrees from upright."""


@entry
def lay_down(hull, row, kind, index):
    """Set the car down at rest, tilted at random about a kind's middle; it has yet to settle."""
    side = 1.0 if chance.uniform(0.0, kind, index, 0.0) < 0.5 else -1.0
    middle = math.pi if kind == 0 else 0.5 * math.pi
    roll = side * middle + chance.between(-0.6, 0.6, 0.0, kind, index, 1.0)
    quat = starts.euler(0.0, chance.between(-0.4, 0.4, 0.0, kind, index, 2.0), roll)
    put(row, r.MOTION, (0.0, 0.0, -starts.lowest(hull, quat)))
    put_quat(row, r.MOTION + 3, quat)


def settle(bank: int = BANK) -> np.ndarray:
    """(2, bank, 4) attitudes in which the nominal car has come to rest, on its roof and on its side."""
    core = Core(1)
    hull = core.grounds[0].model[r.HULL :].reshape(-1, 4)
    zero = np.zeros((1, 3), np.float32)
    attitudes = np.empty((2, bank, 4))
    for k, kind in enumerate(KINDS):
        low, high = (math.cos(math.radians(tilt)) for tilt in TILTS[kind])
        found, index = 0, 0
        while found < bank:
            core.rows[:] = 0.0
            core.rows[0, r.CAR : r.CLOSED] = car.NOMINAL
            lay_down(hull, core.rows[0], k, index)
            index += 1
            if index > 20 * bank:
                raise RuntimeError(f"the car hardly ever settles on its {kind}")
            for _ in range(round(SETTLE_TIME / core.control_dt)):
                core.step(zero)
            motion = core.rows[0, r.MOTION : r.STEPS]
            if high < task.cos_tilt(motion[3:7]) < low and np.abs(motion[7:]).max() < STILL:
                attitudes[k, found] = motion[3:7]
                found += 1
    return attitudes


def fingerprint() -> str:
    """Of the car, as far as it matters to how it settles."""
    body = car.body()
    law = np.array([car.FRICTION, car.RESTITUTION])
    arrays = (np.array([body.m]), body.J, body.hull, body.radius, law)
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


if __name__ == "__main__":
    path = Path(__file__).parent / "settled.npz"
    np.savez(path, attitudes=settle(), car=np.array(fingerprint()))
    print(f"{2 * BANK} attitudes in {path}")
