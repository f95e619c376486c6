"""Play many episodes and count."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from flipcar_env import row as r
from flipcar_env.core import GRAVITY, Core
from flipcar_env.policy import Policy

UNSEEN = 1_000_000_000
"""First seed of evaluations; training uses small ones."""

EACH = 8
"""Starts drawn for each one that is played."""

UP, DOWN = np.cos(np.radians(60.0)), np.cos(np.radians(120.0))
"""Cosine of the tilt: a car that has been above the first flips over again when it falls below the second."""


class Played(NamedTuple):
    """Episodes, one an entry.

    Attributes:
        seeds: of the starts.
        starts: (n, k) the states in which they began.
        roll: of the start, rad.
        pitch: of the start, rad.
        success: has the car been recovered?
        steps: control steps played.
        time: to upright, s; NaN if it was not.
        work: of the actuator, J.
        impulse: the largest of the ground on the car in a control step, N s.
        flips: how often it has flipped over again.
    """

    seeds: np.ndarray
    starts: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray
    success: np.ndarray
    steps: np.ndarray
    time: np.ndarray
    work: np.ndarray
    impulse: np.ndarray
    flips: np.ndarray


def wilson(successes: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a proportion (JASA 22:209, 1927)."""
    p = successes / n
    middle = p + z * z / (2 * n)
    half = z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def attitude(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(roll, pitch) of states (n, k), rad: the car is turned by pitch about y, then by roll about its x."""
    w, x, y, z = states[:, r.MOTION + 3 : r.MOTION + 7].T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))


def begun(seeds: np.ndarray, **arguments: Any) -> Core:
    """An environment for each seed, at the start of the seed's first episode."""
    core = Core(len(seeds), **arguments)
    for i, seed in enumerate(seeds.tolist()):
        core.seed(i, seed)
    core.begin(np.arange(core.n))
    return core


def stratified(n: int, seed: int = UNSEEN, **arguments: Any) -> np.ndarray:
    """(n,) seeds whose starts are spread evenly over the roll and pitch that occur.

    `EACH` times as many are drawn, sorted by roll into strips and in each strip by pitch into cells, so that
    each cell is equally likely; the first drawn of each cell is taken. Every start is as likely as before,
    but a sample has no gaps and no clusters.
    """
    strips = max(1, int(sqrt(n)))
    seeds = seed + np.arange(EACH * n)
    roll, pitch = attitude(begun(seeds, **arguments).states)
    chosen: list[np.ndarray] = []
    cells = [len(part) for part in np.array_split(np.arange(n), strips)]
    for strip, cell in zip(
        np.split(np.argsort(roll, kind="stable"), np.cumsum(cells)[:-1] * EACH), cells, strict=True
    ):
        by_pitch = strip[np.argsort(pitch[strip], kind="stable")]
        chosen.append(by_pitch.reshape(cell, EACH).min(axis=1))
    return seeds[np.sort(np.concatenate(chosen))]


def play(
    agent: Callable[[np.ndarray], np.ndarray],
    seeds: np.ndarray,
    progress: Callable[[Iterable], Iterable] = iter,
    **arguments: Any,
) -> Played:
    """One episode from each start, all side by side.

    Args:
        agent: observations (n, k) to actions (n, 3).
        seeds: of the starts.
        progress: of the control steps.
        arguments: the environment's.
    """
    threads = os.cpu_count() or 1
    core = begun(seeds, threads=threads, **arguments)
    starts = core.states.copy()
    roll, pitch = attitude(starts)
    impulse, flips = np.zeros(core.n), np.zeros(core.n, np.int64)
    been_up = np.cos(core.results[:, r.TILT]) > UP
    fall = np.array([0.0, 0.0, GRAVITY * core.control_dt])
    pool = ThreadPoolExecutor(threads)
    for going in progress(unfinished(core)):
        # only a policy's actions do not depend on who else is asked
        shares = np.array_split(going, threads) if isinstance(agent, Policy) else [going]
        core.actions[going] = np.concatenate(list(pool.map(agent, [core.observed[some] for some in shares])))
        before = core.states[going, r.MOTION + 7 : r.MOTION + 10]
        core.step(core.actions, going)
        gained = core.states[going, r.MOTION + 7 : r.MOTION + 10] - before + fall
        blow = core.states[going, r.MASS] * np.linalg.norm(gained, axis=1)
        impulse[going] = np.maximum(impulse[going], blow)
        upright = np.cos(core.results[going, r.TILT])
        flips[going] += been_up[going] & (upright < DOWN)
        been_up[going] = (upright > UP) | (been_up[going] & (upright >= DOWN))
    pool.shutdown()
    success = core.results[:, r.SUCCESS] > 0.0
    steps, work = core.rows[:, r.STEPS].copy(), core.rows[:, r.WORK].copy()
    time = np.where(success, steps * core.control_dt, np.nan)
    return Played(seeds, starts, roll, pitch, success, steps, time, work, impulse, flips)


def unfinished(core: Core) -> Iterator[np.ndarray]:
    """Before each control step, the environments whose episode is not over."""
    going = np.arange(core.n)
    while going.size:
        yield going
        over = core.results[going, r.TERMINATED] + core.results[going, r.TRUNCATED]
        going = going[over == 0.0]


def summary(played: Played) -> dict[str, Any]:
    """What episodes come to: numbers that JSON takes; None where there is nothing to take a median of."""
    n, won = len(played.seeds), played.success
    low, high = wilson(int(won.sum()), n)

    def percentile(values: np.ndarray, q: float) -> float | None:
        return float(np.percentile(values, q)) if values.size else None

    return {
        "episodes": n,
        "success": float(won.mean()),
        "wilson": [low, high],
        "time_median": percentile(played.time[won], 50),
        "time_p95": percentile(played.time[won], 95),
        "work_median": percentile(played.work[won], 50),
        "impulse_median": percentile(played.impulse, 50),
        "impulse_max": float(played.impulse.max()),
        "flipped_again": float((played.flips > 0).mean()),
    }


def evaluate(
    policy: Callable[[np.ndarray], np.ndarray], start: str = "any", episodes: int = 2000, **arguments: Any
) -> dict[str, Any]:
    """`summary` of an episode from each of many starts that were never trained on."""
    seeds = stratified(episodes, start=start, **arguments)
    return summary(play(policy, seeds, start=start, **arguments))
