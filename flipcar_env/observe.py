"""What the agent sees."""

import numpy as np
from gymnasium import spaces

from solver.algebra import jit, matrix, to_body, to_world

from . import car, chance
from . import row as r

KINDS = ("egocentric", "state", "privileged", "egocentric+action")
EGOCENTRIC, STATE, PRIVILEGED, REMEMBERING = range(4)

FIELD = 100.0
"""m; the episode is cut when the car is further from where it started."""

_SPEED, _SPIN, _FAR = 60.0, 60.0, 150.0
_BOUNDS = {
    # gravity's direction, velocity, angular velocity in the car's axes; height over the ground
    "egocentric": ([-1.0] * 3 + [-_SPEED] * 3 + [-_SPIN] * 3 + [0.0],
                   [1.0] * 3 + [_SPEED] * 3 + [_SPIN] * 3 + [_FAR]),
    # x, quat, v, w, all in world axes
    "state": ([-_FAR] * 3 + [-1.0] * 4 + [-_SPEED] * 3 + [-_SPIN] * 3,
              [_FAR] * 3 + [1.0] * 4 + [_SPEED] * 3 + [_SPIN] * 3),
}  # fmt: skip
_POINTS, _PARAMETERS = len(car.HULL), len(car.NOMINAL)
_GIVEN = 3 * r.MAX_DELAY
_BOUNDS["privileged"] = (
    [*_BOUNDS["state"][0], *_BOUNDS["egocentric"][0]] + [0.0] * _POINTS + [-1.0] * _PARAMETERS + [0.0]
    + [-1.0] * _GIVEN,
    [*_BOUNDS["state"][1], *_BOUNDS["egocentric"][1]] + [1.0] * (_POINTS + _PARAMETERS + 1 + _GIVEN),
)  # fmt: skip
_BOUNDS["egocentric+action"] = (
    _BOUNDS["egocentric"][0] + [-1.0] * 3,
    _BOUNDS["egocentric"][1] + [1.0] * 3,
)
SENSORS = {
    # an attitude estimate good to a degree, velocities to 10 cm/s, a gyroscope to 0.01 rad/s, heights to 5 cm
    "egocentric": np.array([0.02] * 3 + [0.1] * 3 + [0.01] * 3 + [0.05]),
    "state": np.array([0.05] * 3 + [0.01] * 4 + [0.1] * 3 + [0.01] * 3),
}
"""Standard deviations of an observation at `sensor_noise=1`. Privileged ones and actions are the truth."""

_EGOCENTRIC_BOUNDS = np.array(_BOUNDS["egocentric"])
_STATE_BOUNDS = np.array(_BOUNDS["state"])
_EGOCENTRIC_SENSORS, _STATE_SENSORS = SENSORS["egocentric"], SENSORS["state"]
_FIRST_NOISE = 1000.0
"""Index of an episode's first random number for its sensors."""

_MIDDLE, _HALF = car.RANGES.mean(axis=1), 0.5 * np.diff(car.RANGES)[:, 0]


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
def _disturb(row, obs, noise, sensors, bounds):
    """Add the sensors' noise of this step, and keep within the bounds."""
    n = len(sensors)
    at = _FIRST_NOISE + 2.0 * n * row[r.STEPS]
    for i in range(n):
        error = noise * sensors[i] * chance.normal(row[r.KEY], row[r.KEY + 1], row[r.EPISODE], at)
        obs[i] = np.float32(min(bounds[1, i], max(bounds[0, i], obs[i] + error)))
        at += 2.0


@jit
def disturb(view, row, obs, noise):
    """Add noise to an observation: another at each step, the same again from the same state."""
    if view == EGOCENTRIC or view == REMEMBERING:
        _disturb(row, obs, noise, _EGOCENTRIC_SENSORS, _EGOCENTRIC_BOUNDS)
    elif view == STATE:
        _disturb(row, obs, noise, _STATE_SENSORS, _STATE_BOUNDS)


@jit
def egocentric(height, quat, v, w, obs):
    """Fill a (10,) observation; w in the car's axes, height over the ground."""
    rotation = matrix(quat)
    _put(obs, 0, to_body(rotation, (0.0, 0.0, -1.0)), 1.0)
    _put(obs, 3, to_body(rotation, v), _SPEED)
    _put(obs, 6, w, _SPIN)
    obs[9] = np.float32(min(_FAR, max(0.0, height)))


@jit
def newest(row, obs):
    """Fill what follows in a (13,) observation: the last action that was given, (0, 0, 0) at a start."""
    _put(obs, 10, (row[r.NEWEST], row[r.NEWEST + 1], row[r.NEWEST + 2]), 1.0)


@jit
def state(x, quat, v, w, obs):
    """Fill a (13,) observation; w in the car's axes."""
    _put(obs, 0, x, _FAR)
    _put(obs, 3, (quat[0], quat[1], quat[2]), 1.0)
    obs[6] = np.float32(min(1.0, max(-1.0, quat[3])))
    _put(obs, 7, v, _SPEED)
    _put(obs, 10, to_world(matrix(quat), w), _SPIN)


@jit
def privileged(row, height, time_left, x, quat, v, w, obs):
    """Fill a (68,) observation: everything that a critic may know.

    The state (13), the egocentric observation (10), for each hull point if it is in contact (26), the
    car's columns from -1 to 1 between least and most (12), the inertia's at the nominal mass, the share
    of time left, and the last two actions (6).
    """
    state(x, quat, v, w, obs)
    egocentric(height, quat, v, w, obs[13:])
    closed = int(row[r.CLOSED])
    for k in range(_POINTS):
        obs[23 + k] = np.float32((closed >> k) & 1)
    mass = row[r.MASS] / car.MASS
    for k in range(_PARAMETERS):
        value = row[r.CAR + k]
        if r.INERTIA <= r.CAR + k < r.INERTIA + 3:
            value /= mass
        scaled = (value - _MIDDLE[k]) / _HALF[k]
        obs[23 + _POINTS + k] = np.float32(min(1.0, max(-1.0, scaled)))
    at = 23 + _POINTS + _PARAMETERS
    obs[at] = np.float32(min(1.0, max(0.0, time_left)))
    for j in range(_GIVEN):
        obs[at + 1 + j] = np.float32(row[r.GIVEN + j])
