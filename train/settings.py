"""Why the environment steps as it does: the cheapest setting whose error no policy could notice.

The shipped policy drives cars from every kind of start. From the states that it visits, each setting
is played against a very fine one under the same actions, for one control step and for half a second:
longer, and chaos would be measured instead of the setting. An error counts by what it makes of the
policy's next action: only there can a policy show that it has noticed. Beside it stand what a control
step costs, and how many cars the policy recovers.

Every setting starts from the same poses: on roof and side those that the default one has settled.
"""

import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from time import perf_counter
from typing import Any

import numpy as np

from flipcar_env import car, task
from flipcar_env import row as r
from flipcar_env.core import GRAVITY, Core
from flipcar_env.policy import load_policy
from flipcar_env.starts import KINDS
from solver.chart.engine import Ours
from solver.errors import SolverError
from solver.scene import Scene, State, from_kernel, to_kernel
from solver.simulate import simulate

from .evaluate import UNSEEN, unfinished, wilson

Row = dict[str, Any]

DEFAULT = 10
"""Physics steps in a control step of the environment."""
FINER = 20
"""Success at a setting is compared with that at one so many times finer."""
SUBSTEPS = (1, 2, 3, 5, DEFAULT, 20, 40, 60, 100, 200)
"""Settings on trial; of the first five the one `FINER` times finer is on trial, too."""
REFERENCE = 1000
"""Physics steps in a control step of what errors are measured against. "exact" agrees with it to a
float32's resolution in 19 states of 20. In the others the car strikes: there "exact" follows friction's
path (Eq. 12) where "impulse" takes one solve, two laws that no step reconciles."""
RIVALS = (("acceleration", DEFAULT), ("acceleration", 200), ("baumgarte", DEFAULT), ("baumgarte", 200),
          ("exact", 1))  # fmt: skip
"""Other methods on trial, and their steps in a control step ("exact" has none of its own)."""
RIVALS_TIMED = 40
"""States in which they are timed: "exact" takes milliseconds in some."""

NOTICED = 0.01
"""Of full torque: a policy whose action changes by less has not noticed."""
RARE = 99.6
"""Percentile of the states visited: all but one control step of the longest episode, 249 of 250."""
HORIZONS = (1, 13)
"""Control steps after which the error is taken: one, and half a second."""

EMPTY: Row = dict.fromkeys(
    "quantity method substeps control_steps start n failed ns ns_p10 ns_p90 ratio ratio_p10 ratio_p90 "
    "action_p50 action_p95 action_rare obs_p50 obs_p95 obs_rare success low high time_median note".split(),
    "",
)
"""The columns; which of them a row fills depends on its quantity:

    cost     ns of a control step: median, 10th and 90th percentile; the same of its ratio to the default's
    error    of the action, of full torque; of the observation, in standard deviations over the states
             visited; for other methods the cost, too
    success  share of cars recovered with Wilson's interval, and their median time to upright, s
    terms    which terms the car's kernel has
"""


def cells(quick: bool = False) -> list[tuple[tuple[str, ...], Callable[[], Row]]]:
    """The study as (key, function that makes the row), each row for itself.

    Args:
        quick: a few cars and settings, in seconds.
    """
    substeps = (1, DEFAULT, FINER, FINER * DEFAULT) if quick else SUBSTEPS
    rivals = [(method, n) for method, n in RIVALS if n == DEFAULT or not quick]
    episodes = 20 if quick else 2000
    jobs: dict[tuple[str, ...], Callable[[], Row]] = {("terms",): terms}
    for n in substeps:
        jobs["cost", "impulse", str(n)] = partial(cost, n, quick)
        for horizon in HORIZONS:
            jobs["error", "impulse", str(n), str(horizon)] = partial(error, n, horizon, quick)
    for method, n in rivals:
        jobs["error", method, str(n), "1"] = partial(rival, method, n, quick)
    for n in substeps:
        for start in KINDS:
            jobs["success", "impulse", str(n), start] = partial(success, n, start, episodes)
    return list(jobs.items())


@cache
def _policy():
    return load_policy("nominal")


def _core(n: int, substeps: int = DEFAULT) -> Core:
    """Environments that begin as the default ones do, and go on at another setting."""
    core = Core(n)
    core.grounds[0].model[r.SUBSTEPS] = substeps
    return core


def _episodes(core: Core, kinds: list[str]) -> Iterator[np.ndarray]:
    """Play car i from start kinds[i], seeded UNSEEN + i, to its end, where its row stays as it is.

    Yields:
        before each control step, the indices of the cars still going.
    """
    for i in range(len(kinds)):
        core.seed(i, UNSEEN + i)
    core.begin(np.arange(len(kinds)), core.start_kinds(kinds))
    for going in unfinished(core):
        yield going
        core.actions[going] = _policy()(core.observed[going])
        core.step(core.actions, going)


@cache
def visited(quick: bool) -> np.ndarray:
    """Rows (n, width) that the shipped policy comes through, with equally many cars of each kind."""
    kinds = list(KINDS) * (3 if quick else 100)
    core = _core(len(kinds))
    every = 4 if quick else 2
    return np.concatenate(
        [core.rows[going] for t, going in enumerate(_episodes(core, kinds)) if t % every == 0]
    )


def _at(rows: np.ndarray, substeps: int = DEFAULT) -> Core:
    """Environments that go on from rows."""
    core = _core(len(rows), substeps)
    core.rows[:] = rows
    return core


@cache
def _fine(quick: bool) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The policy's actions from the states visited, step by step, and what it then sees, both (n, ...)."""
    core = _at(visited(quick), REFERENCE)
    actions, seen = [], [core.observations()]
    for _ in range(max(HORIZONS)):
        actions.append(_policy()(seen[-1]))
        core.step(actions[-1])
        seen.append(core.observations())
    return actions, seen[1:]


def _differences(obs: np.ndarray, right: np.ndarray, quick: bool) -> dict[str, float]:
    """The columns of an error, from observations (n, k) and the right ones; the largest component counts."""
    spread = _at(visited(quick)).observed.std(axis=0)
    action = np.abs(_policy()(obs) - _policy()(right)).max(axis=1)
    columns = {"action": action, "obs": (np.abs(obs - right) / spread).max(axis=1)}
    return {
        f"{name}_{tail}": float(np.percentile(values, percent))
        for name, values in columns.items()
        for tail, percent in {"p50": 50, "p95": 95, "rare": RARE}.items()
    }


def error(substeps: int, horizon: int, quick: bool) -> Row:
    """Error after so many control steps."""
    core = _at(visited(quick), substeps)
    actions, seen = _fine(quick)
    failed = np.zeros(core.n, dtype=bool)
    for action in actions[:horizon]:
        core.step(action)
        failed |= core.results[:, r.FAILED] != 0.0
    return EMPTY | {
        "quantity": "error",
        "method": "impulse",
        "substeps": substeps,
        "control_steps": horizon,
        "n": core.n,
        "failed": int(failed.sum()),
        **_differences(core.observed, seen[horizon - 1], quick),
    }


def _spread(times: np.ndarray, default: np.ndarray) -> dict[str, float]:
    """The columns of a cost, from ns of control steps timed in turns with the default setting's."""
    tails = {"": 50, "_p10": 10, "_p90": 90}
    columns = {"ns": times, "ratio": times / default}
    return {f"{c}{tail}": float(np.percentile(columns[c], p)) for c in columns for tail, p in tails.items()}


def cost(substeps: int, quick: bool) -> Row:
    """Time of a control step in the states visited; it and the default setting take turns."""
    rows = visited(quick)
    rows = rows[np.random.default_rng(0).permutation(len(rows))[:1000]]
    cores = _at(rows, substeps), _at(rows)
    action, everyone = _policy()(cores[0].observations()), np.arange(len(rows))

    def timed(core: Core) -> float:
        core.rows[:] = rows
        before = perf_counter()
        task.step(core.grounds[0].model, None, core.rows, action, everyone, core.push)
        return 1e9 * (perf_counter() - before) / core.n

    times = np.array([[timed(core) for core in cores] for _ in range(3 if quick else 41)])
    return EMPTY | {
        "quantity": "cost",
        "method": "impulse",
        "substeps": substeps,
        "n": len(rows),
        **_spread(*times.T),
    }


def _scene() -> Scene:
    return Scene(car.body(), gravity=(0.0, 0.0, -GRAVITY), friction=car.FRICTION, restitution=car.RESTITUTION)


def rival(method: str, substeps: int, quick: bool) -> Row:
    """Error and time of another method's control step; starts at which it gives up count as failed.

    The time is the kernel's alone, in turns with the default setting's.
    """
    core, scene = _core(1), _scene()
    rows, (actions, seen) = visited(quick), _fine(quick)
    some = np.random.default_rng(0).permutation(len(rows))[: 20 if quick else 1000]
    ends, right = [], []
    seconds: list[list[float]] = []
    for i in some:
        row, torque = rows[i].copy(), actions[0][i] * np.array(car.TORQUE_LIMIT)
        state = from_kernel(scene.body, row[None, : r.STEPS])
        # "exact" takes no overlap, and time stepping leaves some nanometres.
        lift = max(0.0, -float(scene.gap(state).min()))
        state = State(state.x + np.array([0.0, 0.0, lift]), state.quat, state.v, state.w)
        try:
            run = simulate(scene, state, core.control_dt, core.control_dt / substeps, method, torque=torque)
        except SolverError:
            continue
        row[: r.STEPS] = to_kernel(scene.body, run.state)[0]
        ends.append(row[: r.STATE])
        right.append(seen[0][i])
        if len(seconds) < RIVALS_TIMED:
            pair = (Ours(method), substeps), (Ours("impulse"), DEFAULT)
            seconds.append(
                [engine.play(scene, state, core.control_dt, 1, n, torque[None]).seconds for engine, n in pair]
            )
    found: dict[str, float] = {}
    if ends:
        # What one state costs says little of a control step: groups of them are compared.
        groups = np.array_split(1e9 * np.array(seconds), min(10, len(seconds)))
        found = _spread(*np.array([group.mean(axis=0) for group in groups]).T)
        after = _core(len(ends))
        after.put_states(np.array(ends), np.arange(after.n))
        found |= _differences(after.observed, np.array(right), quick)
    return EMPTY | {
        "quantity": "error",
        "method": method,
        "substeps": substeps,
        "control_steps": 1,
        "n": len(some),
        "failed": len(some) - len(ends),
        **found,
    }


def success(substeps: int, start: str, episodes: int) -> Row:
    """Episodes of the shipped policy from starts that it was not trained on."""
    core = _core(episodes, substeps)
    for _ in _episodes(core, [start] * episodes):
        pass
    up = core.results[:, r.SUCCESS] != 0.0
    low, high = wilson(int(up.sum()), episodes)
    return EMPTY | {
        "quantity": "success",
        "method": "impulse",
        "substeps": substeps,
        "start": start,
        "n": episodes,
        "failed": int((core.results[:, r.FAILED] != 0.0).sum()),
        "success": float(up.mean()),
        "low": low,
        "high": high,
        "time_median": float(np.median(core.rows[up, r.STEPS])) * core.control_dt if up.any() else "",
    }


def terms() -> Row:
    """Which terms the car's kernel has: `Scene.explain` in one line.

    Restitution is one of them, as randomised cars have some.
    """
    scene = Scene(car.body(), friction=car.FRICTION, restitution=car.RESTITUTION_RANGE[1])
    found = re.findall(r"^(\S.*?)\s+(in|out)\s", scene.explain(), re.MULTILINE)
    lists = {where: ", ".join(term for term, is_in in found if is_in == where) for where in ("in", "out")}
    return EMPTY | {"quantity": "terms", "note": f"in: {lists['in']}; out: {lists['out']}"}
