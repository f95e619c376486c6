"""What every kind of environment is made of: rows, buffers and settings, stepped by compiled code."""

import os
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from solver import METHODS, HeightField, Plane
from solver.errors import finite, number, one_of
from solver.scene import UNIT_TOLERANCE

from . import car, observe, reward, starts, task
from . import row as r
from . import terrain as grounds

GRAVITY = 9.81
EPISODE_TIME = 10.0
"""s."""

FEW = 4
"""So many environments, or fewer, are stepped one by one: lanes pay from there on."""

PATIENCE = 2.0
"""s; what is on disk already is loaded in a tenth of that."""

HUGE = 1e300
"""Beyond it a state's energy may be ∞ - ∞."""

ERROR = "the state was no longer finite; it is left as it was before the step"

NOBODY = np.zeros(0, np.int64)
"""Indices of no environment."""


class Ground(NamedTuple):
    """What the environments on one kind of ground share.

    Attributes:
        model: as in `row.model`.
        surface: of the ground.
        which: (m,) indices of these environments.
    """

    model: np.ndarray
    surface: Plane | HeightField
    which: np.ndarray


class Core:
    """The rows, buffers and settings of n environments.

    Args:
        n: how many environments.
        start: kind of start, or "any"; or one for each environment.
        terrain: "level", "slope", "bumpy" or "ditch"; or one for each environment.
        randomize: whether each episode has a car of its own (`car`); or one for each environment.
        obs: "egocentric", "egocentric+action", "state" or "privileged".
        control_dt: s between actions.
        substeps: physics steps in each.
        method: contact method.
        action_delay: control steps from an action to its torque.
        sensor_noise: of observations that are not privileged, in `observe.SENSORS`.
        threads: how many work on the environments; the result's bits do not depend on it.

    Attributes:
        rows: (n, width), one an environment, as in `row`.
        states: (n, k) their part that the future depends on.
        results: (n, RESULTS) their part that the last step has made.
        observed: (n, m) float32, the observations.
        settings: arguments that are the same for all.
        terrains: the kind of ground of each.
        grounds: the kinds of ground that there are, and who is on them.
        push: (p, PUSH) N s, of the last environment stepped alone: the impulse on each hull point.
    """

    def __init__(
        self,
        n: int = 1,
        start: str | Sequence[str] = "any",
        terrain: str | Sequence[str] = "level",
        randomize: bool | Sequence[bool] = False,
        obs: str = "egocentric",
        control_dt: float = 0.04,
        substeps: int = 10,
        method: str = "impulse",
        action_delay: int = 0,
        sensor_noise: float = 0.0,
        threads: int = 1,
    ):
        self.n = whole("num_envs", n, 1)
        self.threads = whole("threads", threads, 1)
        one_of("obs", obs, observe.KINDS)
        control_dt = number("control_dt", control_dt, above=0.0, high=0.5)
        substeps = whole("substeps", substeps, 1, 1000)
        action_delay = whole("action_delay", action_delay, 0, r.MAX_DELAY)
        sensor_noise = number("sensor_noise", sensor_noise, low=0.0)
        if one_of("method", method, METHODS) != "impulse":
            raise ValueError(f"method must be 'impulse' in the environment, got {method!r}")
        self.kinds = self.start_kinds(start)
        self.terrains = self.names("terrain", terrain, grounds.KINDS)
        self.random = self.flags("randomize", randomize)
        self.obs_kind = obs
        self.control_dt = control_dt
        self.settings: dict[str, Any] = {
            "obs": obs,
            "control_dt": control_dt,
            "substeps": substeps,
            "method": method,
            "action_delay": action_delay,
            "sensor_noise": sensor_noise,
        }
        body = car.body()
        self.points = len(body.hull)

        def ground(kind: str) -> Ground:
            surface = grounds.surface(kind)
            model = r.model(
                body,
                surface.parameters,
                GRAVITY,
                car.N_WHEELS,
                control_dt,
                substeps,
                round(EPISODE_TIME / control_dt),
                int(np.ceil(reward.HOLD_TIME / control_dt - 1e-9)),
                observe.KINDS.index(obs),
                0.0 if kind == "level" else grounds.SCATTER,
                action_delay,
                sensor_noise,
            )
            return Ground(model, surface, np.flatnonzero([one == kind for one in self.terrains]))

        self.grounds = [ground(kind) for kind in dict.fromkeys(self.terrains)]
        self.observation_space = observe.space(obs)
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.rows = np.zeros((n, r.width(self.observation_space.shape[0])))
        self._name_parts()
        self.actions = np.zeros((n, 3), np.float32)
        self.push = np.zeros((self.points, task.PUSH))
        with announced():  # so that the first step is as quick as any
            self.begin(NOBODY)
            for one in self.grounds:
                self._step(one, NOBODY, self.actions, self.push)

    def _name_parts(self) -> None:
        self.states = self.rows[:, : r.STATE]
        self.results = self.rows[:, r.STATE : r.OBSERVED]
        observed = self.rows.view(np.float32)[:, 2 * r.OBSERVED :]
        self.observed = observed[:, : self.observation_space.shape[0]]

    def __setstate__(self, values: dict[str, Any]) -> None:
        self.__dict__.update(values)
        self._name_parts()  # a pickled or copied view would be an array of its own

    def start_kinds(self, start: Any, name: str = "start") -> np.ndarray:
        """(n,) indices of kinds of start, from one kind or one for each environment."""
        kinds = [*starts.KINDS, "any"]  # so "any" gets `starts.ANY`
        return np.array([kinds.index(kind) for kind in self.names(name, start, kinds)])

    def names(self, name: str, value: Any, allowed: Iterable[str]) -> list[str]:
        """One of the names allowed for each environment, from one for all or one for each."""
        values = [value] * self.n if isinstance(value, str) else self.each(name, value)
        for one in values[:1] if isinstance(value, str) else values:
            one_of(name, one, allowed)
        return values

    def flags(self, name: str, value: Any) -> np.ndarray:
        """(n,) truths, from one or one for each environment."""
        values = [value] * self.n if isinstance(value, bool | np.bool_) else self.each(name, value)
        for flag in values:
            if not isinstance(flag, bool | np.bool_):
                raise ValueError(f"{name} must be True or False, or one for each, got {flag!r}")
        return np.array(values, dtype=np.bool_)

    def each(self, name: str, value: Any) -> list:
        """One value for each environment."""
        if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or len(value) != self.n:
            raise ValueError(f"{name} must be one value or one for each of {self.n}, got {value!r}")
        return list(value)

    def indices(self, indices: Any) -> np.ndarray:
        """Indices of environments, from one, several or None: all.

        Raises:
            ValueError: there are no such environments, or they are told by a mask.
        """
        if indices is None:
            return np.arange(self.n)
        which = np.array([*indices] if isinstance(indices, Iterable) else [indices])
        if not which.size:
            return np.zeros(0, np.int64)
        if which.ndim != 1 or which.dtype.kind not in "iu" or which.min() < 0 or which.max() >= self.n:
            raise ValueError(f"indices must be whole numbers from 0 to {self.n - 1}, got {indices!r}")
        return which

    def seed(self, i: int, seed: int) -> None:
        """Give environment i the random stream of a seed, from its first episode."""
        self.rows[i, r.KEY] = (seed >> 32) & 0xFFFFFFFF
        self.rows[i, r.KEY + 1] = seed & 0xFFFFFFFF
        self.rows[i, r.EPISODE] = -1

    def begin(self, which: np.ndarray, kinds: np.ndarray | None = None) -> None:
        """Begin the next episode of some environments.

        Args:
            which: their indices.
            kinds: (n,) of start, in place of the environments' own.
        """
        kinds = self.kinds if kinds is None else kinds
        bank = starts.settled()
        for ground, some in self.shares(which):
            starts.begin(ground.model, ground.surface.field, bank, self.rows, some, kinds, self.random)

    def put_states(self, states: np.ndarray, which: np.ndarray) -> None:
        """Set checked states of some environments."""
        self.states[which] = states
        for ground, some in self.shares(which):
            task.look(ground.model, ground.surface.field, self.rows, some)

    def shares(self, which: np.ndarray) -> list[tuple[Ground, np.ndarray]]:
        """Each kind of ground, and which of some environments are on it."""
        if len(self.grounds) == 1:
            return [(self.grounds[0], which)]
        return [(ground, np.intersect1d(ground.which, which)) for ground in self.grounds]

    def step(self, actions: np.ndarray, which: np.ndarray | None = None) -> None:
        """One control step of all, or of some, from (n, 3) float32 actions, in place.

        Raises:
            ValueError: an action is not finite; nothing has changed then.
        """
        if self.n == 1:  # half of its time is Python's
            model, surface, which = self.grounds[0]
            if task.step(model, surface.field, self.rows, actions, which, self.push) >= 0:
                raise ValueError(f"actions must be finite, got {actions[0].tolist()}")
            return
        which = np.arange(self.n) if which is None else which
        sound = np.isfinite(actions if len(which) == self.n else actions[which])
        if not sound.all():
            bad = which[np.argmin(sound.all(axis=1))]
            raise ValueError(f"actions must be finite, got {actions[bad].tolist()} for environment {bad}")
        shares = self.shares(which)

        def work(thread: int) -> None:
            push = np.empty_like(self.push)
            for ground, some in shares:
                begin, end = (len(some) * t // self.threads for t in (thread, thread + 1))
                self._step(ground, some[begin:end], actions, push)

        if self.threads == 1:
            work(0)
            return
        pool = _pool(os.getpid(), self.threads)
        others = [pool.submit(work, thread) for thread in range(1, self.threads)]
        work(0)
        for other in others:
            other.result()

    def _step(self, ground: Ground, some: np.ndarray, actions: np.ndarray, push: np.ndarray) -> None:
        """Step some environments on one ground; their actions are finite."""
        if ground.surface.field is None and self.n > FEW:
            task.step_many(ground.model, self.rows, actions, some)
        else:
            task.step(ground.model, ground.surface.field, self.rows, actions, some, push)

    def pictures(self) -> np.ndarray:
        """(n, height, width, 3) uint8: each environment's car as it is now."""
        from . import picture

        pictures = np.empty((self.n, picture.HEIGHT, picture.WIDTH, 3), np.uint8)
        for ground in self.grounds:
            pictures[ground.which] = picture.draw(self.states[ground.which], ground.surface)
        return pictures

    def info(self, i: int, results: list[float]) -> dict[str, Any]:
        """The info of environment i after a step, from its results."""
        # Names for all, once, and literals: anything neater costs as much as the physics.
        progress, won, time, effort, _, _, _, success, energy, tilt, contacts, work, failed = results
        info = {
            "is_success": success != 0.0,
            "energy": energy,
            "work": work,
            "tilt": tilt,
            "n_contacts": int(contacts),
            "reward_terms": {"progress": progress, "success": won, "time": time, "effort": effort},
        }
        if success:
            info["time_to_upright"] = float(self.rows[i, r.STEPS]) * self.control_dt
        if failed:
            info["solver_error"] = ERROR
            info["solver_error_state"] = self.states[i].copy()
        return info

    def start_info(self, i: int) -> dict[str, Any]:
        """The info of environment i after a reset."""
        info = self.info(i, self.results[i].tolist())
        info["work"] = float(self.rows[i, r.WORK])
        info["start"] = starts.KINDS[int(self.rows[i, r.START])]
        return info

    def seeds(self, seed: Any) -> list[int | None]:
        """One seed for each environment: environment i gets seed + i, or the list's i-th.

        Raises:
            ValueError: not whole numbers >= 0 or None, or a list of another length.
        """
        if seed is None or isinstance(seed, int | np.integer):
            first = None if seed is None else whole("seed", seed, 0)
            return [None if first is None else first + i for i in range(self.n)]
        seeds = self.each("seed", seed)
        return [None if one is None else whole("seed", one, 0) for one in seeds]

    def ended(self) -> tuple[np.ndarray, np.ndarray]:
        """(terminated, truncated), each (n,), after a step."""
        return self.results[:, r.TERMINATED] != 0.0, self.results[:, r.TRUNCATED] != 0.0

    def observations(self) -> np.ndarray:
        """(n, m) float32, freshly made."""
        return self.observed.copy()

    def take(self, actions: Any, shape: tuple[int, ...], name: str = "actions") -> np.ndarray:
        """Check actions, and copy them into (n, 3) float32 of our own.

        For one that is strided, or that can't be written to, the step would be compiled once more.

        Raises:
            ValueError: not real numbers, or another shape.
        """
        try:
            array = np.asarray(actions)
        except ValueError as error:  # ragged
            raise ValueError(f"{name} must be real numbers of shape {shape}, got {actions!r}") from error
        if array.dtype.kind not in "fiub":
            raise ValueError(f"{name} must be real numbers, got {array.dtype}")
        if array.shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
        self.actions[...] = array
        return self.actions

    def check_states(self, states: Any, n: int | None = None, name: str = "state") -> np.ndarray:
        """State arrays as `get_state` gives them: (STATE,), or (n, STATE).

        Raises:
            ValueError: wrong shape, not finite, or not a state.
        """
        shape = (r.STATE,) if n is None else (n, r.STATE)
        array = finite(name, states, shape)

        def must(holds, column, words):
            if not np.all(holds):
                worst = array[..., column] if n is None else array[~holds, column][0]
                raise ValueError(f"{name}'s {words}, got {worst:g}")

        motion = abs(array[..., : r.STEPS]).max(axis=-1)
        if not np.all(motion <= HUGE):
            raise ValueError(f"{name}'s motion must be within ±{HUGE:g}, got {motion.max():g}")
        norm = np.linalg.norm(array[..., 3:7], axis=-1)
        if not np.all(abs(norm - 1.0) <= UNIT_TOLERANCE):
            worst = norm.flat[np.argmax(abs(norm - 1.0))]
            raise ValueError(f"{name}'s quaternion (entries 3 to 6) must have norm 1, got {worst:g}")
        kinds = len(starts.KINDS)
        start, closed = array[..., r.START], array[..., r.CLOSED]
        must((start >= 0) & (start < kinds), r.START, f"start (entry {r.START}) must be 0 to {kinds - 1}")
        must(
            (closed >= 0) & (closed < 2**self.points) & (closed % 1 == 0),
            r.CLOSED,
            f"contacts (entry {r.CLOSED}) must be a whole number below 2^{self.points}",
        )
        must(array[..., r.MASS] > 0, r.MASS, f"mass (entry {r.MASS}) must be > 0")
        moments = array[..., r.INERTIA : r.INERTIA + 3]
        largest = moments.max(axis=-1)
        must(
            (moments.min(axis=-1) > 0) & (moments.sum(axis=-1) - 2.0 * largest >= -1e-9 * largest),
            r.INERTIA,
            f"moments of inertia (entries {r.INERTIA} to {r.INERTIA + 2}) must be a body's",
        )
        limits = array[..., r.LIMIT : r.LIMIT + 3].min(axis=-1)
        must(limits >= 0, r.LIMIT, f"torque limits (entries {r.LIMIT} to {r.LIMIT + 2}) must be >= 0")
        must(array[..., r.FRICTION] >= 0, r.FRICTION, f"friction (entry {r.FRICTION}) must be >= 0")
        e = array[..., r.RESTITUTION]
        must((e >= 0) & (e <= 1), r.RESTITUTION, f"restitution (entry {r.RESTITUTION}) must be 0 to 1")
        return array


@contextmanager
def announced() -> Iterator[None]:
    """Say that something is being compiled, if what is done within takes so long that it must be."""
    words = "FlipCar: compiling the physics for this processor, once; it takes about half a minute"
    timer = threading.Timer(PATIENCE, print, (words,), {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def whole(name: str, value: Any, low: int, high: int | None = None) -> int:
    """A whole number from `low` to `high`.

    Raises:
        ValueError: it is not.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, int | np.integer)
        or value < low
        or (high is not None and value > high)
    ):
        allowed = f">= {low}" if high is None else f"from {low} to {high}"
        raise ValueError(f"{name} must be a whole number {allowed}, got {value!r}")
    return int(value)


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """The threads of a process: those of the process it was forked from are not in it."""
    return ThreadPoolExecutor(threads)
