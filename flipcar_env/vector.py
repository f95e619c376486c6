"""The Gymnasium vector environment: many cars in one compiled call."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from solver.errors import one_of

from . import reward, starts
from . import row as r
from .core import ERROR, Core
from .env import FlipCarEnv, check_render_mode, refuse_both


class FlipCarVectorEnv(VectorEnv):
    """`num_envs` cars, stepped side by side; environment i seeded s + i is the single one, bit for bit.

    `gym.make_vec("FlipCar-v0", num_envs=n, vectorization_mode="vector_entry_point")` makes it. Spaces,
    rewards, ends and infos are those of `FlipCarEnv`; infos are arrays, as Gymnasium has them.

    Args:
        num_envs: how many.
        start: kind of start, or one for each environment.
        terrain: kind of ground, or one for each environment.
        randomize: whether each episode has a car of its own, or one truth for each environment.
        obs: "egocentric", "egocentric+action", "state" or "privileged".
        render_mode: "rgb_array" or None.
        control_dt: s between actions.
        substeps: physics steps in each.
        method: contact method.
        action_delay: control steps from an action to its torque.
        sensor_noise: of observations that are not privileged.
        threads: how many work on the environments; the result's bits do not depend on it.
        autoreset_mode: when a finished environment begins its next episode, as Gymnasium defines it.

    Raises:
        ValueError: an argument is not what it must be.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (VectorEnv declares it so)
        **FlipCarEnv.metadata,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        start: str | Sequence[str] = "any",
        terrain: str | Sequence[str] = "level",
        randomize: bool | Sequence[bool] = False,
        obs: str = "egocentric",
        render_mode: str | None = None,
        control_dt: float = 0.04,
        substeps: int = 10,
        method: str = "impulse",
        action_delay: int = 0,
        sensor_noise: float = 0.0,
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ):
        self.render_mode = check_render_mode(render_mode, self.metadata["render_modes"])
        modes = [mode.value for mode in AutoresetMode]
        mode = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self.autoreset_mode = AutoresetMode(one_of("autoreset_mode", mode, modes))
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        core = Core(
            num_envs,
            start,
            terrain,
            randomize,
            obs,
            control_dt,
            substeps,
            method,
            action_delay,
            sensor_noise,
            threads,
        )
        self.core = core
        self.num_envs = core.n
        self.single_observation_space = core.observation_space
        self.single_action_space = core.action_space
        self.observation_space = batch_space(core.observation_space, core.n)
        self.action_space = batch_space(core.action_space, core.n)
        self._over = np.zeros(core.n, dtype=np.bool_)
        self._started = np.zeros(core.n, dtype=np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every environment, or in those of a mask.

        Args:
            seed: of the streams; environment i gets seed + i, or the list's i-th. None goes on.
            options: {"start": kind or one each}, {"state": (n, k)}, {"reset_mask": (n,) of bool}.

        Raises:
            ValueError: seed or options are not what they must be; nothing has changed then.
        """
        core = self.core
        options = options or {}
        for name in options:
            one_of("options", name, ("start", "state", "reset_mask"))
        refuse_both(options)
        seeds = core.seeds(seed)
        kinds = core.start_kinds(options["start"]) if "start" in options else None
        mask = self._mask(options["reset_mask"]) if "reset_mask" in options else np.ones(core.n, np.bool_)
        states = core.check_states(options["state"], core.n) if "state" in options else None
        if not (mask | self._started).all():
            raise ValueError(
                f"reset_mask must be true for environments never reset: {np.flatnonzero(~self._started)[0]}"
            )

        super().reset(seed=seeds[0])
        which = np.flatnonzero(mask)
        for i in which.tolist():
            one = seeds[i]
            if one is None and not self._started[i]:
                one = int(self.np_random.integers(2**63))
            if one is not None:
                core.seed(i, one)
        if states is None:
            core.begin(which, kinds)
        else:
            core.put_states(states[which], which)
        self._started |= mask
        self._over &= ~mask
        infos = self._infos(mask, mask)
        return core.observations(), infos

    def _mask(self, mask: Any) -> np.ndarray:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be a bool array of shape ({self.num_envs},), got {mask!r}")
        if not mask.any():
            raise ValueError(f"reset_mask must have a True in it, got {mask!r}")
        return mask

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control step of all.

        Args:
            actions: (n, 3), clipped to [-1, 1]. In mode NEXT_STEP that of an environment whose episode is
                over counts for nothing, whatever it is: it begins the next one.

        Raises:
            ValueError: actions of another shape or type, or not finite, or an environment whose episode is
                over or has not begun; nothing has changed then.
        """
        core = self.core
        if not self._started.all():
            raise ValueError("environments must be reset before the first step")
        disabled = self.autoreset_mode == AutoresetMode.DISABLED
        if disabled and self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise ValueError(f"environments must be reset when their episode is over; it is in {over}")
        actions, began = core.take(actions, (core.n, 3)), self._over
        some_begin = began.any()  # only in mode NEXT_STEP
        if some_begin:
            actions = np.where(began[:, None], np.float32(0.0), actions)
        core.step(actions)
        if some_begin:
            core.begin(np.flatnonzero(began))
        terminated, truncated = core.ended()
        rewards = core.results[:, r.REWARD].copy()
        over = terminated | truncated
        everyone = np.ones(core.n, np.bool_)
        if self.autoreset_mode == AutoresetMode.SAME_STEP and over.any():
            finals = self._finals(over)
            core.begin(np.flatnonzero(over))
            infos = {**self._infos(everyone, over), **finals}
            over = np.zeros_like(over)
        else:
            infos = self._infos(everyone, began)
        self._over = over
        return core.observations(), rewards, terminated, truncated, infos

    def _finals(self, over: np.ndarray) -> dict[str, Any]:
        """What the episodes ended with."""
        final_obs = np.full(self.num_envs, None, dtype=object)
        for one in np.flatnonzero(over).tolist():
            final_obs[one] = self.core.observed[one].copy()
        return {
            "final_obs": final_obs,
            "_final_obs": over.copy(),
            "final_info": self._infos(over, np.zeros_like(over)),
            "_final_info": over.copy(),
        }

    def _infos(self, which: np.ndarray, began: np.ndarray) -> dict[str, Any]:
        """The infos of some environments: name to array, and _name to the mask of those that have it."""
        results = self.core.results

        def of(column: int) -> np.ndarray:
            return np.where(which, results[:, column], 0.0)

        infos: dict[str, Any] = {
            "is_success": of(r.SUCCESS) != 0.0,
            "energy": of(r.ENERGY),
            "work": np.where(which, self.core.rows[:, r.WORK], 0.0),
            "tilt": of(r.TILT),
            "n_contacts": of(r.N_CONTACTS).astype(np.int64),
        }
        terms: dict[str, Any] = {name: of(r.TERMS + k) for k, name in enumerate(reward.TERMS)}
        for group in (terms, infos):
            for name in list(group):
                group[f"_{name}"] = which.copy()
        infos["reward_terms"], infos["_reward_terms"] = terms, which.copy()
        won = infos["is_success"]
        if won.any():
            time = self.core.rows[:, r.STEPS] * self.core.control_dt
            infos["time_to_upright"], infos["_time_to_upright"] = np.where(won, time, 0.0), won.copy()
        failed = of(r.FAILED) != 0.0
        if failed.any():
            words = np.full(self.num_envs, None, dtype=object)
            words[failed] = ERROR
            infos["solver_error"], infos["_solver_error"] = words, failed
            states = np.where(failed[:, None], self.core.states, 0.0)
            infos["solver_error_state"], infos["_solver_error_state"] = states, failed.copy()
        if began.any():
            kinds = np.full(self.num_envs, None, dtype=object)
            for one in np.flatnonzero(began).tolist():
                kinds[one] = starts.KINDS[int(self.core.rows[one, r.START])]
            infos["start"], infos["_start"] = kinds, began.copy()
        return infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each car as it is now, (360, 480, 3) uint8; None unless asked for by `render_mode`.

        Raises:
            ValueError: there has been no reset yet.
        """
        if not self._started.all():
            raise ValueError("environments must be reset before they are rendered")
        return tuple(self.core.pictures()) if self.render_mode == "rgb_array" else None

    def get_state(self) -> np.ndarray:
        """(n, k): everything that the environments' futures depend on."""
        return self.core.states.copy()

    def set_state(self, state: np.ndarray, indices: Sequence[int] | None = None) -> None:
        """Go on from what `get_state` gave, in all environments or in those of some indices.

        Raises:
            ValueError: it is not such an array, or no such environments; nothing has changed then.
        """
        which = self.core.indices(indices)
        self.core.put_states(self.core.check_states(state, len(which)), which)
        self._started[which] = True
        self._over[which] = False
