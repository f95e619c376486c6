"""How fast the environment steps, as a ratio to a known one in the same process."""

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import flipcar_env
from flipcar_env.policy import Policy

BLOCK = 1000
"""Steps timed in one go; the environments take turns, block by block."""


def _time(env: gym.Env, act: Callable[[int, Any], Any]) -> float:
    """Microseconds a step over one block, resets included."""
    obs, _ = env.reset()
    spent = 0.0
    for i in range(BLOCK):
        action = act(i, obs)
        before = time.perf_counter()
        obs, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            obs, _ = env.reset()
        spent += time.perf_counter() - before
    return 1e6 * spent / BLOCK


def bench(policy: Policy, rounds: int = 30, progress: Callable = iter) -> dict[str, Any]:
    """Step times of `gym.make("FlipCar-v0")` beside `gym.make("CartPole-v1")`.

    Args:
        policy: drives one of the cars; choosing actions is not timed.
        rounds: blocks of each.
        progress: wraps the loop over rounds.

    Returns:
        For each way of driving: median microseconds a step, and the median, 10th and 90th percentile
        of the ratio CartPole / FlipCar over the rounds (above 1: FlipCar is the faster).
    """
    rng = np.random.default_rng(0)
    noise = rng.uniform(-1.0, 1.0, (BLOCK, 3)).astype(np.float32)
    zero = np.zeros(3, np.float32)
    flips = rng.integers(0, 2, BLOCK).tolist()

    def make(start: str = "any") -> gym.Env:
        env = gym.make("FlipCar-v0", start=start)
        env.reset(seed=0)
        return env

    cartpole = gym.make("CartPole-v1")
    cartpole.reset(seed=0)
    ways: dict[str, tuple[gym.Env, Callable[[int, Any], Any]]] = {
        "at rest, no torque (start roof)": (make("roof"), lambda i, obs: zero),
        "shipped policy (start any)": (make(), lambda i, obs: policy(obs)),
        "random torque every step (start any)": (make(), lambda i, obs: noise[i]),
    }
    table: dict[str, list[float]] = {name: [] for name in ways}
    reference = []
    for env, act in ways.values():  # once unseen, so that nothing compiles while timed
        _time(env, act)
    for _ in progress(range(rounds)):
        reference.append(_time(cartpole, lambda i, obs: flips[i]))
        for name, (env, act) in ways.items():
            table[name].append(_time(env, act))
    result: dict[str, Any] = {
        "version": flipcar_env.__version__,
        "rounds": rounds,
        "steps_a_round": BLOCK,
        "substeps_a_step": 10,
        "cartpole_us": float(np.median(reference)),
    }
    for name, times in table.items():
        ratio = np.array(reference) / np.array(times)
        result[name] = {
            "us": float(np.median(times)),
            "ratio": float(np.median(ratio)),
            "ratio_p10_p90": [float(r) for r in np.percentile(ratio, [10, 90])],
        }
    return result
