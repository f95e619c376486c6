"""Agents that have learned nothing: the task is measured by what they reach.

Each maps observations (n, 10 or more), "egocentric" or with the action, to actions (n, 3).
"""

from collections.abc import Callable
from itertools import product

import numpy as np

Agent = Callable[[np.ndarray], np.ndarray]

DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)], dtype=np.float32)
"""(26, 3) of constant torque: every combination of full, none and full the other way."""

ANGLE_GAIN, SPIN_GAIN = 4.0, 0.8
"""Of "pd": full torque from a quarter of a radian on; 0.8 of it for each rad/s against it."""


def zero(obs: np.ndarray) -> np.ndarray:
    """No torque."""
    return np.zeros((len(obs), 3), np.float32)


def random(seed: int = 0) -> Agent:
    """Another torque at each step."""
    rng = np.random.default_rng(seed)
    return lambda obs: rng.uniform(-1.0, 1.0, (len(obs), 3)).astype(np.float32)


def constant(direction: np.ndarray) -> Agent:
    """Always the same torque."""
    return lambda obs: np.tile(np.asarray(direction, np.float32), (len(obs), 1))


def pd(obs: np.ndarray) -> np.ndarray:
    """To upright on the shortest way, damped."""
    up = -obs[:, :3]
    across = np.hypot(up[:, 0], up[:, 1])
    angle = np.arctan2(across, up[:, 2])
    # the axis that turns the car's z axis up: z x up, and roll where that is none
    safe = np.maximum(across, 1e-9)
    axis = np.stack([np.where(across > 1e-9, -up[:, 1] / safe, 1.0), up[:, 0] / safe, 0.0 * angle], axis=1)
    return np.clip(ANGLE_GAIN * angle[:, None] * axis - SPIN_GAIN * obs[:, 6:9], -1.0, 1.0).astype(np.float32)


def autoflip(obs: np.ndarray) -> np.ndarray:
    """Pump energy into the roll until the car is past its side, then `pd`."""
    over = obs[:, 2] > 0.0
    action = pd(obs)
    action[over] = 0.0
    action[over, 0] = np.where(obs[over, 6] < 0.0, -1.0, 1.0)
    return action
