"""What every kind of environment is made of: rows, buffers and settings, stepped by compiled code."""

import itertools
import os
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces

from solver import METHODS, Plane
from solver.errors import finite, number, one_of
from solver.scene import UNIT_TOLERANCE

from . import car, observe, reward, starts, task
from . import row as r

GRAVITY = 9.81
EPISODE_TIME = 10.0
"""s."""

TERRAINS = ("level",)

FEW = 4
"""So many environments, or fewer, are stepped one by one: lanes pay from there on."""

PATIENCE = 2.0
"""s; what is on disk already is loaded in a tenth of that."""

HUGE = 1e300
"""Beyond it a state's energy may be ∞ - ∞."""

ERROR = "the state was no longer finite; it is left as it was before the step"


class Core:
    """The rows, buffers and settings of n environments.

    Args:
        n: how many environments.
        start: kind of start, or "any"; or one for each environment.
        terrain: "level".
        randomize: whether each episode has a car of its own (`car`); or one for each environment.
        obs: "egocentric" or "state".
        control_dt: s between actions.
        substeps: physics steps in each.
        method: contact method.
        threads: how many work on the environments; the result's bits do not depend on it.

    Attributes:
        rows: (n, width), one an environment, as in `row`.
        states: (n, k) their part that the future depends on.
        results: (n, RESULTS) their part that the last step has made.
        observed: (n, m) float32, the observations.
    """

    def __init__(
        self,
        n: int = 1,
        start: str | Sequence[str] = "any",
        terrain: str = "level",
        randomize: bool | Sequence[bool] = False,
        obs: str = "egocentric",
        control_dt: float = 0.04,
        substeps: int = 10,
        method: str = "impulse",
        threads: int = 1,
    ):
        self.n = whole("num_envs", n, 1)
        self.threads = whole("threads", threads, 1)
        one_of("terrain", terrain, TERRAINS)
        one_of("obs", obs, observe.KINDS)
        control_dt = number("control_dt", control_dt, above=0.0, high=0.5)
        substeps = whole("substeps", substeps, 1, 1000)
        if one_of("method", method, METHODS) != "impulse":
            raise ValueError(f"method must be 'impulse' in the environment, got {method!r}")
        self.kinds = self.start_kinds(start)
        self.random = self.flags("randomize", randomize)
        self.obs_kind = obs
        self.control_dt = control_dt
        body = car.body()
        self.points = len(body.hull)
        self.car = r.car(body, (0.0, 0.0, 0.0), (car.FRICTION, car.RESTITUTION), car.TORQUE_LIMIT)
        self.model = r.model(
            body,
            Plane(),
            GRAVITY,
            car.N_WHEELS,
            control_dt,
            substeps,
            round(EPISODE_TIME / control_dt),
            int(np.ceil(reward.HOLD_TIME / control_dt - 1e-9)),
            observe.KINDS.index(obs),
        )
        self.observation_space = observe.space(obs)
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.rows = np.zeros((n, r.width(self.observation_space.shape[0])))
        self._name_parts()
        self.actions = np.zeros((n, 3), np.float32)
        self.push = np.zeros((self.points, 3))
        """N s, of the last environment stepped alone: each hull point's impulse in world axes."""
        with announced():  # so that the first step is as quick as any
            self.begin(np.zeros(0, np.int64))
            rows, actions = self.rows[:0], np.zeros((0, 3), np.float32)
            if n <= FEW:
                task.step(self.model, rows, actions, self.push)
            else:
                task.step_many(self.model, rows, actions)

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
        if isinstance(start, str):
            return np.full(self.n, kinds.index(one_of(name, start, kinds)))
        return np.array([kinds.index(one_of(name, kind, kinds)) for kind in self.each(name, start)])

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
        starts.begin(self.model, self.car, bank, self.rows, which, kinds, self.random)

    def put_states(self, states: np.ndarray, which: np.ndarray) -> None:
        """Set checked states of some environments."""
        self.states[which] = states
        task.look(self.model, self.rows, which)

    def step(self, actions: np.ndarray) -> None:
        """One control step of all, from (n, 3) float32 actions, in place.

        Raises:
            ValueError: an action is not finite; nothing has changed then.
        """
        if self.n <= FEW:
            bad = task.step(self.model, self.rows, actions, self.push)
            if bad >= 0:
                raise self._not_finite(actions, bad)
            return
        sound = np.isfinite(actions)
        if not sound.all():
            raise self._not_finite(actions, int(np.flatnonzero(~sound.all(axis=1))[0]))
        if self.threads == 1:
            task.step_many(self.model, self.rows, actions)
            return
        cuts = np.linspace(0, self.n, self.threads + 1).astype(int)
        shares = [(self.rows[a:b], actions[a:b]) for a, b in itertools.pairwise(cuts) if a < b]
        pool = _pool(os.getpid(), self.threads)
        others = [pool.submit(task.step_many, self.model, *share) for share in shares[1:]]
        task.step_many(self.model, *shares[0])
        for other in others:
            other.result()

    def _not_finite(self, actions: np.ndarray, i: int) -> ValueError:
        """What to raise for environment i's action."""
        whose = "" if self.n == 1 else f" for environment {i}"
        return ValueError(f"actions must be finite, got {actions[i].tolist()}{whose}")

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
