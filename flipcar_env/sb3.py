"""A native Stable-Baselines3 vector environment: SB3 steps the batch kernel without an adapter."""

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from solver.errors import one_of

from . import row as r
from . import starts
from .core import Core, whole
from .env import FlipCarEnv, check_render_mode, refuse_both

KINDS = (*starts.KINDS, "any")


class FlipCarVecEnv(VecEnv):
    """`num_envs` cars in one compiled call; environment i is the single one seeded s + i, bit for bit.

    A finished environment starts its next episode at once. Its info then has what SB3 reads:
    `terminal_observation`, `TimeLimit.truncated`, `is_success` and `episode` (return, length, time);
    infos of the others stay empty.

    Args:
        num_envs: how many.
        stagger: cut the first episodes short, each after another number of steps. Otherwise all that are
            not won run out of time together, again and again: a batch of one phase of the task only.
            False for episodes that are the single environment's from the first.
        render_mode: "rgb_array" or None.
        **arguments: those of `gym.make_vec("FlipCar-v0", ...)`, but `autoreset_mode`.
    """

    metadata = FlipCarEnv.metadata

    def __init__(self, num_envs: int, stagger: bool = True, render_mode: str | None = None, **arguments: Any):
        self.core = Core(num_envs, **arguments)
        self.render_mode = check_render_mode(render_mode, ["rgb_array"])
        if not isinstance(stagger, bool):
            raise ValueError(f"stagger must be True or False, got {stagger!r}")
        self.stagger = stagger
        super().__init__(num_envs, self.core.observation_space, self.core.action_space)
        self._returns, self._lengths = np.zeros(num_envs), np.zeros(num_envs, np.int64)
        self._limits = np.full(num_envs, np.inf)
        self._keyed = False
        self._began = time.time()

    def seed(self, seed: int | None = None) -> Sequence[int]:
        """Seed environment i with seed + i, from the next reset on."""
        if seed is None:
            seed = int(np.random.SeedSequence().generate_state(1)[0])
        self._seeds = self.core.seeds(seed)
        return list(self._seeds)  # type: ignore[arg-type]

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set what the next reset starts from: {"start": kind} or {"state": array}, for all or one for each.

        Raises:
            ValueError: other options, kinds or lengths; the options set before stay then.
        """
        options = options or {}
        for one in [options] if isinstance(options, dict) else self.core.each("options", options):
            for name, value in one.items():
                if one_of("options", name, ("start", "state")) == "start":
                    one_of("start", value, KINDS)
                else:
                    self.core.check_states(value)
            refuse_both(one)
        super().set_options(options)

    def reset(self) -> np.ndarray:
        """Start an episode in every environment, by the options that `set_options` has given."""
        kinds = self.core.kinds.copy()
        for i, options in enumerate(self._options):
            if "start" in options:
                kinds[i] = KINDS.index(options["start"])
        if not self._keyed and self._seeds[0] is None:
            self.seed()
        for i, seed in enumerate(self._seeds):
            if seed is not None:
                self.core.seed(i, seed)
        self.core.begin(np.arange(self.num_envs), kinds)
        for i, options in enumerate(self._options):
            if "state" in options:
                self._set_state(i, options["state"])
        self._keyed = True
        self.reset_infos = [self.core.start_info(i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        self._limits[:] = np.inf
        if self.stagger:
            share = np.arange(1, self.num_envs + 1) / self.num_envs
            self._limits[:] = np.ceil(self.core.grounds[0].model[r.MAX_STEPS] * share)
        return self.core.observations()

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, (num_envs, 3).

        Raises:
            ValueError: not such actions, or there has been no reset yet.
        """
        if not self._keyed:
            raise ValueError("environments must be reset before the first step")
        self.core.take(actions, (self.num_envs, 3))

    def step_wait(self):
        """One control step of all. Observations are fresh arrays each time."""
        core = self.core
        core.step(core.actions)
        obs = core.observations()
        rewards = core.results[:, r.REWARD].astype(np.float32)
        terminated, truncated = core.ended()
        truncated |= ~terminated & (core.rows[:, r.STEPS] >= self._limits)
        dones = terminated | truncated
        self._returns += core.results[:, r.REWARD]
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            which = np.flatnonzero(dones)
            now = round(time.time() - self._began, 6)
            for i in which.tolist():
                infos[i] = {
                    **core.info(i, core.results[i].tolist()),
                    "terminal_observation": obs[i].copy(),
                    "TimeLimit.truncated": bool(truncated[i]),
                    "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": now},
                }
            self._returns[which], self._lengths[which] = 0.0, 0
            self._limits[which] = np.inf
            core.begin(which)
            obs[which] = core.observed[which]
        return obs, rewards, dones, infos

    def close(self) -> None:
        """Nothing to release."""

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture of each car as it is now; None unless asked for by `render_mode`."""
        return list(self.core.pictures()) if self.render_mode == "rgb_array" else [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """`start` of each environment; any other attribute is this object's, once for each index."""
        if attr_name == "start":
            return [KINDS[self.core.kinds[i]] for i in self._get_indices(indices)]
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set `start` of each environment in `indices`, for the episodes to come."""
        one_of("attr_name", attr_name, ("start",))
        kind = self.core.start_kinds(value)
        which = self._get_indices(indices)
        self.core.kinds[which] = kind[which]

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """`get_state()` and `set_state(array)` of each environment in `indices`."""
        methods: dict[str, Callable[..., Any]] = {
            "get_state": self._get_state,
            "set_state": self._set_state,
        }
        method = methods[one_of("method_name", method_name, methods)]
        return [method(i, *method_args, **method_kwargs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def _get_indices(self, indices: int | Iterable[int] | None) -> list[int]:
        return self.core.indices(indices).tolist()

    def _get_state(self, i: int) -> np.ndarray:
        return self.core.states[i].copy()

    def _set_state(self, i: int, state: np.ndarray) -> None:
        self.core.put_states(self.core.check_states(state), np.array([i]))
        self._returns[i], self._lengths[i] = 0.0, 0
        self._limits[i] = np.inf  # it was the limit of the episode that this one replaces


class RecordEpisodes(BaseCallback):
    """Record every so-manyth episode of a training for rerun, each to a file of its own.

    The first car's start and its actions are kept, no more; when its episode is over, another environment
    replays it, to the bit. So the training goes on as it would without.

    Args:
        folder: for the recordings, each named by the training's steps at its end; made if it is not there.
        every: episodes of all cars from one recording to the next.
    """

    def __init__(self, folder: str | Path, every: int = 100):
        super().__init__()
        self.every = whole("every", every, 1)
        self.folder = Path(folder)

    def _on_training_start(self) -> None:
        cars = self.training_env.unwrapped
        if not isinstance(cars, FlipCarVecEnv):
            raise ValueError(f"the training's environment must be a FlipCarVecEnv, got {cars!r}")
        self.core, self.over, self.due = cars.core, 0, 0
        self.folder.mkdir(parents=True, exist_ok=True)
        self.env = FlipCarEnv(**self.core.settings, terrain=self.core.terrains[0])
        self.actions: list[np.ndarray] | None = None
        self._begin()

    def _begin(self) -> None:
        if self.over >= self.due:
            self.start, self.actions = self.core.states[0].copy(), []
            self.due = self.over + self.every

    def _on_step(self) -> bool:
        dones = self.locals["dones"]
        self.over += int(np.count_nonzero(dones))
        if self.actions is not None:
            self.actions.append(self.core.actions[0].copy())
        if dones[0]:
            if self.actions is not None:
                self._keep(self.actions)
                self.actions = None
            self._begin()
        return True

    def _keep(self, actions: list[np.ndarray]) -> None:
        from . import recording, rollout

        name = f"{self.num_timesteps:010d}"
        episode = rollout.replay(self.env, self.start, actions, f"after {name} steps")
        recording.save(self.folder / f"{name}.rrd", [episode])
