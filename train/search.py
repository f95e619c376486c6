"""The quickest recovery that a search through saved states finds from a start.

Breadth first: for so many control steps one of 27 torques is held, then simple controllers take over and play
to the end. Of all beginnings those are kept from which one was upright soonest, and begun further. What is
found is a sequence of torques that recovers the car; it need not be the quickest there is. A policy may play
from the start, too: then no start is recovered later than by it.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from flipcar_env import row as r
from flipcar_env.core import Core

from .agents import DIRECTIONS, Agent
from .evaluate import begun

HOLD = 5
"""Control steps for which a torque is held."""

KEPT = 3
"""Beginnings that go on."""

MANY = 12
"""Starts that are searched from side by side."""

TORQUES = np.concatenate([np.zeros((1, 3), np.float32), DIRECTIONS])


def search(
    agents: Sequence[Agent],
    seeds: np.ndarray,
    policy: Agent | None = None,
    progress: Callable[[Iterable], Iterable] = iter,
    **arguments: Any,
) -> np.ndarray:
    """(n,) control steps until the car is upright and still, from each start; infinite if it never is.

    Args:
        agents: that take over.
        seeds: of the starts.
        policy: that plays from the start only.
        progress: of groups of starts.
        arguments: the environment's.
    """
    starts = begun(seeds, **arguments).states.copy()
    groups = np.array_split(starts, max(1, len(starts) // MANY))
    first = [*agents, policy] if policy else agents
    return np.concatenate([_search(agents, first, group, arguments) for group in progress(groups)])


def _search(
    agents: Sequence[Agent], first: Sequence[Agent], starts: np.ndarray, arguments: dict[str, Any]
) -> np.ndarray:
    n, k = starts.shape
    limit = np.full(n, np.inf)
    for agent in first:
        limit = np.minimum(limit, _played(agent, starts, limit, arguments))
    kept = starts[:, None]
    last = int(Core(1, **arguments).grounds[0].model[r.MAX_STEPS])
    for depth in range(last // HOLD):
        if (limit <= HOLD * (depth + 1)).all():
            break
        b = kept.shape[1]
        states = np.repeat(kept.reshape(n * b, k), len(TORQUES), axis=0)
        torques = np.tile(TORQUES, (n * b, 1))
        limits = np.repeat(limit, b * len(TORQUES))
        states, found = _held(states, torques, arguments)
        for agent in agents:
            found = np.minimum(found, _played(agent, states, np.minimum(limits, found), arguments))
        found = found.reshape(n, -1)
        limit = np.minimum(limit, found.min(axis=1))
        best = np.argsort(found, axis=1, kind="stable")[:, :KEPT]
        kept = np.take_along_axis(states.reshape(n, -1, k), best[:, :, None], axis=1)
    return limit


def _held(
    states: np.ndarray, torques: np.ndarray, arguments: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """The states after torques have been held, and when the car was upright and still: mostly never."""
    core = Core(len(states), **arguments)
    core.put_states(states, np.arange(core.n))
    found = np.full(core.n, np.inf)
    for _ in range(HOLD):
        going = np.flatnonzero(core.results[:, r.TERMINATED] + core.results[:, r.TRUNCATED] == 0.0)
        core.step(torques, going)
        won = going[core.results[going, r.SUCCESS] > 0.0]
        found[won] = core.rows[won, r.STEPS]
    return core.states.copy(), found


def _played(agent: Agent, states: np.ndarray, limit: np.ndarray, arguments: dict[str, Any]) -> np.ndarray:
    """When an agent has the car upright and still, if before a limit."""
    core = Core(len(states), **arguments)
    core.put_states(states, np.arange(core.n))
    found = np.full(core.n, np.inf)
    going = np.flatnonzero(core.rows[:, r.STEPS] + 1.0 < limit)
    while going.size:
        core.actions[going] = agent(core.observed[going])
        core.step(core.actions, going)
        won = going[core.results[going, r.SUCCESS] > 0.0]
        found[won] = core.rows[won, r.STEPS]
        on = core.results[going, r.TERMINATED] + core.results[going, r.TRUNCATED] == 0.0
        going = going[on & (core.rows[going, r.STEPS] + 1.0 < limit[going])]
    return found
