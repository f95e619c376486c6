"""What the agent sees."""

import numpy as np
from gymnasium import spaces

from solver.algebra import jit, matrix, to_body, to_world

KINDS = ("egocentric", "state")
EGOCENTRIC, STATE = range(2)

FIELD = 100.0
"""m; the episode is cut when the car is further from where it started."""

_SPEED, _SPIN, _FAR = 60.0, 60.0, 150.0
_BOUNDS = {
    # gravity's direction, velocity, angular velocity in the car's axes; height of the centre of mass
    "egocentric": ([-1.0] * 3 + [-_SPEED] * 3 + [-_SPIN] * 3 + [0.0],
                   [1.0] * 3 + [_SPEED] * 3 + [_SPIN] * 3 + [_FAR]),
    # x, quat, v, w, all in world axes
    "state": ([-_FAR] * 3 + [-1.0] * 4 + [-_SPEED] * 3 + [-_SPIN] * 3,
              [_FAR] * 3 + [1.0] * 4 + [_SPEED] * 3 + [_SPIN] * 3),
}  # fmt: skip


def space(kind: str) -> spaces.Box:
    """The observation space of a kind: float32, and every observation is clipped into it."""
    low, high = (np.array(bound, dtype=np.float32) for bound in _BOUNDS[kind])
    return spaces.Box(low, high, dtype=np.float32)


@jit
def _put(obs, at, a, bound):
    """Store a vector, clipped to ±bound."""
    obs[at] = np.float32(min(bound, max(-bound, a[0])))
    obs[at + 1] = np.float32(min(bound, max(-bound, a[1])))
    obs[at + 2] = np.float32(min(bound, max(-bound, a[2])))


@jit
def egocentric(x, quat, v, w, obs):
    """Fill a (10,) observation; w in the car's axes."""
    rotation = matrix(quat)
    _put(obs, 0, to_body(rotation, (0.0, 0.0, -1.0)), 1.0)
    _put(obs, 3, to_body(rotation, v), _SPEED)
    _put(obs, 6, w, _SPIN)
    obs[9] = np.float32(min(_FAR, max(0.0, x[2])))


@jit
def state(x, quat, v, w, obs):
    """Fill a (13,) observation; w in the car's axes."""
    _put(obs, 0, x, _FAR)
    _put(obs, 3, (quat[0], quat[1], quat[2]), 1.0)
    obs[6] = np.float32(min(1.0, max(-1.0, quat[3])))
    _put(obs, 7, v, _SPEED)
    _put(obs, 10, to_world(matrix(quat), w), _SPIN)
