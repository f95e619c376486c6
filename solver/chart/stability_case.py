"""What a scene of the stability map is, and what its judges use."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from solver.chart.engine import Trajectory
from solver.rotation import to_matrix
from solver.scene import Scene, State

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


def starts(*rows: Sequence) -> State:
    """A batch of (x, quat, v, w)."""
    return State(*(np.array([row[i] for row in rows], dtype=float) for i in range(4)))


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
