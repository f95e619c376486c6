"""Is a batch of environments what one of them is? A check for any environment that comes in a batch."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

REFUSALS = (ValueError, AssertionError)
"""What an environment may raise for a bad action."""


def check_vec_env(
    make_single: Callable[[], gym.Env],
    make_vector: Callable[[int], VectorEnv] | None = None,
    make_sb3: Callable[[int], Any] | None = None,
    num_envs: int = 4,
    seed: int = 0,
    steps: int = 300,
) -> None:
    """Check that environment i of a batch seeded s is the single environment seeded s + i, bit for bit.

    Random actions are played in the batch and, side by side, in single environments. Observations, rewards,
    ends, final observations, time-limit flags and the starts of the next episodes must be equal; a reward
    once the single one's is rounded to the batch's type. No array that was handed out may change by the
    next step. The same seed must start the same episodes again, at once and after all the steps. If the
    single environment refuses (with ValueError or AssertionError) an action in a Box that is not a number,
    or of another shape, so must the batch, if only the last environment gets it; and none of its
    environments may be changed by that. What the single one takes, the batch is not asked.

    Args:
        make_single: makes a single environment.
        make_vector: makes a Gymnasium vector environment of so many, in any autoreset mode.
        make_sb3: makes a Stable-Baselines3 VecEnv of so many.
        num_envs: how many.
        seed: of the first environment.
        steps: how many; enough for some episodes to end.

    Raises:
        AssertionError: it is not; names the environment, the step and what differs.
        ValueError: no episode ended, so half of it was not checked.
    """
    if make_vector is not None:
        batch = make_vector(num_envs)
        _check(make_single, _Vector(batch), num_envs, seed, steps)
        batch.close()
    if make_sb3 is not None:
        env = make_sb3(num_envs)
        _check(make_single, _SB3(env), num_envs, seed, steps)
        env.close()


class _Vector:
    """A Gymnasium vector environment."""

    exclusive = False

    def __init__(self, env: VectorEnv):
        self.env, self.name = env, "vector environment"
        self.mode = AutoresetMode(env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP))

    def reset(self, seed):
        return self.env.reset(seed=seed)[0]

    def step(self, actions):
        """(obs, reward, terminated, truncated, final observations) of all, and what was handed out."""
        obs, reward, terminated, truncated, infos = self.env.step(actions)
        handed = {
            "observations": obs,
            "rewards": reward,
            "terminations": terminated,
            "truncations": truncated,
        }
        over = terminated | truncated
        finals = list(obs)
        if self.mode == AutoresetMode.SAME_STEP and over.any():
            finals = [infos["final_obs"][i] if end else obs[i] for i, end in enumerate(over)]
            handed["final observations"] = [final for final, end in zip(finals, over, strict=True) if end]
        if self.mode == AutoresetMode.DISABLED and over.any():
            obs = self.env.reset(options={"reset_mask": over})[0]
        return obs, reward, terminated, truncated, finals, handed


class _SB3:
    """A Stable-Baselines3 VecEnv."""

    mode = AutoresetMode.SAME_STEP
    exclusive = True
    """An end is a time limit's only if it is not another."""

    def __init__(self, env: Any):
        self.env, self.name = env, "SB3 environment"

    def reset(self, seed):
        self.env.seed(seed)
        return self.env.reset()

    def step(self, actions):
        obs, reward, done, infos = self.env.step(actions)
        truncated = np.array([bool(info.get("TimeLimit.truncated", False)) for info in infos])
        finals = [
            info["terminal_observation"] if end else obs[i]
            for i, (end, info) in enumerate(zip(done, infos, strict=True))
        ]
        handed = {"observations": obs, "rewards": reward, "dones": done}
        handed["final observations"] = [final for final, end in zip(finals, done, strict=True) if end]
        return obs, reward, done & ~truncated, truncated, finals, handed


def _check(make_single, batch, n, seed, steps):
    singles = [make_single() for _ in range(n)]
    space = singles[0].action_space
    space.seed(seed)

    def compare(i, step, what, got, want):
        if not _same(got, want):
            after = f" after {refused} refused calls" if step == 2 and refused else ""
            raise AssertionError(
                f"{batch.name} {i}, step {step}{after}: {what} is {got!r}, the single one's is {want!r}"
            )

    first = np.copy(batch.reset(seed))
    obs = batch.reset(seed)
    if not _same(obs, first):
        raise AssertionError(f"{batch.name}: the same seed does not start the same episodes")
    for i, env in enumerate(singles):
        compare(i, 0, "the first observation", obs[i], env.reset(seed=seed + i)[0])

    bad, refused = _refused(make_single), 0
    over = np.zeros(n, dtype=bool)
    ended = 0
    handed: dict[str, Any] = {"observations": obs}
    for step in range(1, steps + 1):
        actions = np.array([space.sample() for _ in range(n)])
        if step == 2:
            _check_refusals(batch, actions, bad)
            refused = len(bad)
        before, copies = handed, {what: np.copy(array) for what, array in handed.items()}
        obs, reward, terminated, truncated, finals, handed = batch.step(actions)
        for what, copy in copies.items():
            if not _same(before[what], copy):
                raise AssertionError(f"{batch.name}, step {step}: {what} handed out before have changed")
        for i, env in enumerate(singles):
            if batch.mode == AutoresetMode.NEXT_STEP and over[i]:
                want = (env.reset()[0], 0.0, False, False)
            else:
                want = env.step(actions[i])[:4]
            compare(i, step, "the reward", reward[i], np.asarray(reward).dtype.type(want[1]))
            compare(i, step, "terminated", terminated[i], want[2])
            compare(i, step, "truncated", truncated[i], want[3] and not (batch.exclusive and want[2]))
            over[i] = want[2] or want[3]
            ended += over[i]
            compare(i, step, "the final observation" if over[i] else "the observation", finals[i], want[0])
            if over[i] and batch.mode != AutoresetMode.NEXT_STEP:
                compare(i, step, "the next episode's observation", obs[i], env.reset()[0])
    if not _same(batch.reset(seed), first):
        raise AssertionError(f"{batch.name}: after {steps} steps the same seed starts other episodes")
    if not ended:
        raise ValueError(f"steps must be enough for an episode to end, got {steps}")
    for env in singles:
        env.close()


def _same(a: Any, b: Any) -> bool:
    """Equal, in the sign of zero too."""
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype.kind != "f" or b.dtype.kind != "f":
        return np.array_equal(a, b)
    return np.array_equal(a, b, equal_nan=True) and np.array_equal(np.signbit(a), np.signbit(b))


def _longer(actions: np.ndarray) -> np.ndarray:
    return np.concatenate([actions, actions], axis=-1)


def _last_is_nan(actions: np.ndarray) -> np.ndarray:
    spoilt = np.array(actions)
    spoilt[-1] = np.nan
    return spoilt


def _refused(make_single) -> list[Callable[[np.ndarray], np.ndarray]]:
    """Ways to spoil actions of which the single environment refuses the last."""
    if not isinstance(make_single().action_space, gym.spaces.Box):
        return []
    found: list[Callable[[np.ndarray], np.ndarray]] = []
    for spoil in (_longer, _last_is_nan):
        env = make_single()
        env.reset(seed=0)
        try:
            env.step(spoil(env.action_space.sample()[None])[-1])
        except REFUSALS:
            found.append(spoil)
        env.close()
    return found


def _check_refusals(batch, actions, ways):
    for spoil in ways:
        try:
            batch.step(spoil(actions))
        except REFUSALS:
            continue
        raise AssertionError(f"{batch.name}: takes {spoil(actions)!r}, which the single one refuses")
