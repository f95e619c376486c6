"""Play many episodes and count."""

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np

from flipcar_env import row as r
from flipcar_env.core import Core

UNSEEN = 1_000_000_000
"""First seed of evaluations; training uses small ones."""


def wilson(successes: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a proportion (JASA 22:209, 1927)."""
    p = successes / n
    middle = p + z * z / (2 * n)
    half = z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def evaluate(
    policy: Callable[[np.ndarray], np.ndarray],
    start: str = "any",
    episodes: int = 2000,
    seed: int = UNSEEN,
) -> dict[str, Any]:
    """One episode from each of many starts, all played side by side.

    Args:
        policy: observations (n, k) to actions (n, 3).
        start: kind of start.
        episodes: how many; episode i is the first of seed + i.
        seed: of the first.

    Returns:
        success rate with Wilson's interval; median and 95th percentile of the time to upright, s,
        and the median work, J, of those that succeeded (None if none did).
    """
    core = Core(episodes, start=start)
    for i in range(episodes):
        core.seed(i, seed + i)
    core.begin(np.arange(episodes))
    obs = core.observations()
    running = np.ones(episodes, dtype=bool)
    success = np.zeros(episodes, dtype=bool)
    time, work = np.full(episodes, np.nan), np.full(episodes, np.nan)
    while running.any():
        core.step(policy(obs))
        obs = core.observations()
        ended = running & ((core.results[:, r.TERMINATED] + core.results[:, r.TRUNCATED]) > 0)
        success |= ended & (core.results[:, r.SUCCESS] > 0)
        time[ended] = core.rows[ended, r.STEPS] * core.control_dt
        work[ended] = core.rows[ended, r.WORK]
        running &= ~ended
    low, high = wilson(int(success.sum()), episodes)
    some = success.any()
    return {
        "start": start,
        "episodes": episodes,
        "seed": seed,
        "success": float(success.mean()),
        "wilson": [low, high],
        "time_median": float(np.median(time[success])) if some else None,
        "time_p95": float(np.percentile(time[success], 95)) if some else None,
        "work_median": float(np.median(work[success])) if some else None,
    }
