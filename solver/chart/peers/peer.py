"""What all other engines have in common: the `Engine` protocol around one world that is stepped."""

from importlib.metadata import version
from time import perf_counter
from typing import Any, ClassVar, Protocol

import numpy as np

from solver.chart.engine import EngineError, Trajectory
from solver.errors import one_of
from solver.scene import Scene, State, from_kernel, to_kernel, to_principal
from solver.surface import Plane

TIMED_SECONDS = 0.02
"""A run shorter than this is repeated, and the median of its times taken."""
MAX_ROUNDS = 20
EMPTY_ROUNDS = 3


class World(Protocol):
    """One scene in another engine, at a fixed step.

    States are rows as of `solver.scene.to_kernel`: x, quat, v in world and w in principal axes.
    """

    def put(self, row: np.ndarray) -> None:
        """Start anew from a state (13,)."""

    def go(self, n: int, torque: np.ndarray | None) -> None:
        """n steps; torque (3,) N m in principal axes."""

    def row(self) -> np.ndarray:
        """The state (13,).

        Raises:
            EngineError: the engine itself reports that something is wrong.
        """


class Peer:
    """Another engine, as an `Engine`.

    A subclass names itself and its package, gives its default settings, and builds a `World`.

    Args:
        settings: in place of `defaults`, by name.

    Raises:
        ValueError: no such setting.
    """

    name: str
    package: str
    module: str
    extra: str = "peers"
    """The extra of this project that installs it."""
    note: str
    """Where its contact model differs by design."""
    defaults: ClassVar[dict[str, Any]]

    def __init__(self, **settings: Any):
        for setting in settings:
            one_of(f"settings of {self.name}", setting, self.defaults)
        self.version = version(self.package)
        self.settings: dict[str, Any] = {**self.defaults, **settings}

    def world(self, scene: Scene, h: float) -> World:
        """The scene in this engine, at a step of h (s)."""
        raise NotImplementedError

    def refuses(self, scene: Scene) -> str | None:
        """Why this engine cannot play the scene, or None."""
        if not isinstance(scene.surface, Plane):
            return "of grounds, only planes are the same for every engine"
        return None

    def play(
        self,
        scene: Scene,
        starts: State,
        duration: float,
        records: int,
        steps: int,
        torque: np.ndarray | None = None,
    ) -> Trajectory:
        """As in `Engine`; the starts one after another. The time is the stepping's, less that of no steps."""
        reason = self.refuses(scene)
        if reason is not None:
            raise EngineError(f"{self.name} cannot play this: {reason}")
        world = self.world(scene, duration / records / steps)
        torques = None if torque is None else to_principal(scene.body, torque)
        rows = to_kernel(scene.body, starts)
        out = np.empty((records + 1, len(rows), 13))
        seconds = [_play(world, rows, torques, steps, out)]
        again = np.empty_like(out)
        rounds = min(MAX_ROUNDS, int(TIMED_SECONDS / max(seconds[0], 1e-9)))
        seconds += [_play(world, rows, torques, steps, again) for _ in range(rounds)]
        nothing = [_play(world, rows, torques, 0, again) for _ in range(EMPTY_ROUNDS)]
        each = max(0.0, float(np.median(seconds) - np.median(nothing))) / len(rows)
        out[..., 3:7] /= np.linalg.norm(out[..., 3:7], axis=-1, keepdims=True)
        state = from_kernel(scene.body, out.reshape(-1, 13))
        x, quat, v, w = (
            array.reshape(*out.shape[:2], -1) for array in (state.x, state.quat, state.v, state.w)
        )
        t = duration / records * np.arange(records + 1)
        return Trajectory(t, x, quat, v, w, each)


def _play(world: World, rows: np.ndarray, torques: np.ndarray | None, steps: int, out: np.ndarray) -> float:
    """Play every start into out (records + 1, k, 13), so many steps a record; the stepping's time, s."""
    total = 0.0
    for k, row in enumerate(rows):
        world.put(row)
        out[0, k] = row
        for record in range(1, len(out)):
            tau = None if torques is None else torques[record - 1]
            before = perf_counter()
            world.go(steps, tau)
            total += perf_counter() - before
            state = world.row()
            if not np.isfinite(state).all():
                raise EngineError(
                    f"the state of start {k} is not finite at record {record}: {state.tolist()}"
                )
            out[record, k] = state
    return total
