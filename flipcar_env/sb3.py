"""A native Stable-Baselines3 vector environment: SB3 steps the batch kernel without an adapter."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from . import row as r
from .core import Core


class FlipCarVecEnv(VecEnv):
    """`num_envs` cars in one compiled call; environment i is the single one seeded s + i, bit for bit.

    A finished environment starts its next episode at once. Its info then has what SB3 reads:
    `terminal_observation`, `TimeLimit.truncated`, `is_success` and `episode` (return, length, time);
    infos of the others stay empty.

    Args:
        num_envs: how many.
        **arguments: those of `gym.make("FlipCar-v0", ...)`.
    """

    def __init__(self, num_envs: int, **arguments: Any):
        self.core = Core(num_envs, **arguments)
        self.render_mode = None
        super().__init__(num_envs, self.core.observation_space, self.core.action_space)
        self._returns = np.zeros(num_envs)
        self._actions = np.zeros((num_envs, 3), np.float32)
        self._keyed = False

    def seed(self, seed: int | None = None) -> Sequence[int]:
        """Seed environment i with seed + i, from the next reset on."""
        if seed is None:
            seed = int(np.random.SeedSequence().entropy) % 2**32  # type: ignore[arg-type]
        seeds = [seed + i for i in range(self.num_envs)]
        self._seeds = list(seeds)
        return seeds

    def reset(self) -> np.ndarray:
        """Start an episode in every environment."""
        if not self._keyed and self._seeds[0] is None:
            self.seed()
        for i, seed in enumerate(self._seeds):
            if seed is not None:
                self.core.set_key(i, seed)
            self.core.begin(i, self.core.start)
        self._keyed = True
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        return self.core.observations()

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, (num_envs, 3)."""
        actions = np.ascontiguousarray(actions, dtype=np.float32)
        if actions.shape != self._actions.shape:
            raise ValueError(f"actions must have shape {self._actions.shape}, got {actions.shape}")
        self._actions = actions

    def step_wait(self):
        """One control step of all. Observations are fresh arrays each time."""
        core = self.core
        core.step(self._actions)
        obs = core.observations()
        rewards = core.results[:, r.REWARD].astype(np.float32)
        truncated = core.results[:, r.TRUNCATED] != 0.0
        dones = truncated | (core.results[:, r.TERMINATED] != 0.0)
        self._returns += core.results[:, r.REWARD]
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(dones).tolist():
            steps = int(core.rows[i, r.STEPS])
            infos[i] = core.info(i, core.results[i].tolist())
            infos[i]["terminal_observation"] = obs[i].copy()
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
            infos[i]["episode"] = {
                "r": float(self._returns[i]),
                "l": steps,
                "t": steps * core.control_dt,
            }
            self._returns[i] = 0.0
            core.begin(i, core.start)
            obs[i] = core.observed[i]
        return obs, rewards, dones, infos

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of this object, once for each index."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of this object; all environments share it."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """`get_state()` and `set_state(array)` of each environment in `indices`."""
        methods: dict[str, Callable[..., Any]] = {
            "get_state": self._get_state,
            "set_state": self._set_state,
        }
        if method_name not in methods:
            raise ValueError(
                f"method_name must be one of {', '.join(map(repr, methods))}, got {method_name!r}"
            )
        method = methods[method_name]
        return [method(i, *method_args, **method_kwargs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def _get_indices(self, indices: int | Iterable[int] | None) -> Iterable[int]:
        return range(self.num_envs) if indices is None else super()._get_indices(indices)

    def _get_state(self, i: int) -> np.ndarray:
        return self.core.states[i].copy()

    def _set_state(self, i: int, state: np.ndarray) -> None:
        self.core.states[i] = self.core.check_state(state)
