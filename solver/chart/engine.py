"""What can play a scene: one signature for this solver's methods and for other engines.

An engine plays a batch of starts and returns where they were at equally spaced times, and how long the
stepping alone took. Everything that a chart shows comes from that.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np

from solver.errors import SolverError
from solver.model import MEMORY
from solver.scene import Scene, State, to_kernel, to_principal
from solver.simulate import EXTRA, KERNELS, kernel_arguments, option_values, simulate
from solver.terms import full

TIMED_SECONDS = 0.02
"""A run shorter than this is repeated, and the median of its times taken."""
MAX_ROUNDS = 200


class EngineError(RuntimeError):
    """An engine that cannot go on with a run; the message says why."""


@dataclass(frozen=True)
class Trajectory:
    """What an engine made of a batch of k starts.

    Attributes:
        t: (T,) s, equally spaced from 0.
        x: (T, k, 3) centre of mass, m.
        quat: (T, k, 4) w, x, y, z, body to world.
        v: (T, k, 3) velocity of the centre of mass, m/s.
        w: (T, k, 3) rad/s, world axes.
        seconds: wall time that one of the k starts took, set-up left out.
    """

    t: np.ndarray
    x: np.ndarray
    quat: np.ndarray
    v: np.ndarray
    w: np.ndarray
    seconds: float

    @property
    def ns_per_second(self) -> float:
        """Wall time of a simulated second, ns."""
        return 1e9 * self.seconds / self.t[-1]

    def at(self, record: int) -> State:
        """The batch's state at a record."""
        return State(self.x[record], self.quat[record], self.v[record], self.w[record])


class Engine(Protocol):
    """Anything that plays scenes.

    Attributes:
        name: as it stands in charts.
        version: of the engine.
        settings: what it was set to, name to value.
    """

    name: str
    version: str
    settings: dict[str, object]

    def refuses(self, scene: Scene) -> str | None:
        """Why this engine cannot play the scene at all, or None. A note on its model may stand in `note`."""

    def play(
        self,
        scene: Scene,
        starts: State,
        duration: float,
        records: int,
        steps: int,
        torque: np.ndarray | None = None,
    ) -> Trajectory:
        """Play a batch of starts, each for itself.

        Args:
            scene: body, surface, gravity, friction, restitution.
            starts: with a leading axis: (k, ...).
            duration: s.
            records: how many equal intervals are recorded; row 0 is the start.
            steps: in each of them; so the step is duration / (records steps).
            torque: (records, 3) N m in body axes, held during each interval; none unless given.

        Raises:
            EngineError: the run cannot go on, or its state is no longer finite.
        """


class Ours:
    """A method of `solver.simulate`.

    Args:
        method: one of `solver.METHODS`.
        lean: its kernel has the scene's own terms only. If not it has every term, which changes no bit: one
            kernel serves all scenes, so that a quick look need not compile one for each.
        timed: if not, a run's time is 0 and takes none: for where only the answer counts.
        options: of the method.
    """

    def __init__(self, method: str, lean: bool = True, timed: bool = True, **options):
        self.name = method
        self.version = "this"
        self.settings = options
        self.lean = lean
        self.timed = timed

    def refuses(self, scene: Scene) -> str | None:
        """Nothing is refused beforehand."""
        return None

    def play(self, scene, starts, duration, records, steps, torque=None) -> Trajectory:
        """As in `Engine`. The time is the kernel's alone: of its calls, less that of as many empty ones."""
        if not self.lean:
            scene = copy(scene)
            scene.law = full(scene.friction, scene.restitution)
        interval = duration / records
        h = interval / steps
        torques = np.zeros((1, 3)) if torque is None else torque
        try:
            run = simulate(
                scene,
                starts,
                duration,
                dt=h,
                method=self.name,
                torque=lambda t: torques[min(len(torques) - 1, round(t / interval))],
                record_every=steps,
                options=self.settings,
            )
        except SolverError as error:
            raise EngineError(str(error)) from error
        if not self.timed:
            return Trajectory(run.t, run.x, run.quat, run.v, run.w, 0.0)
        calls = self._calls(scene, starts, to_principal(scene.body, torques), h)
        pieces = records * steps // len(torques)
        times: list[float] = []
        until = perf_counter() + TIMED_SECONDS
        while not times or (len(times) < MAX_ROUNDS and perf_counter() < until):
            times.append(calls(pieces) - calls(0))
        return Trajectory(run.t, run.x, run.quat, run.v, run.w, max(0.0, float(np.median(times))))

    def _calls(self, scene: Scene, starts: State, torques: np.ndarray, h: float) -> Callable[[int], float]:
        """A function that times the kernel, n steps under each torque from every start: s for one start."""
        kernel, points = KERNELS[self.name], len(scene.body.hull)
        what = kernel_arguments(scene, self.name)
        flags = option_values(self.name, self.settings)
        f = np.zeros(points)
        rows = to_kernel(scene.body, starts)

        def calls(n: int) -> float:
            total = 0.0
            for start in rows:
                row, memory = start.copy(), np.zeros((points + EXTRA.get(self.name, 0), MEMORY))
                before = perf_counter()
                for tau in torques:
                    kernel(*what, scene.gravity, tau, row, memory, f, flags, h, n)
                total += perf_counter() - before
            return total / len(rows)

        return calls
