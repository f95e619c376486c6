"""How fast the environment is, as ratios to known things in the same process, measured in turns.

Times of a shared machine mean little: what counts is the ratio of two that took turns. An environment step
is one action; it has ten physics steps, the substeps. The two are never mixed.
"""

import csv
import time
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import flipcar_env  # noqa: F401 (registers the environment)
from flipcar_env import car
from flipcar_env import row as r
from flipcar_env.core import Core
from flipcar_env.policy import load_policy
from solver.chart.store import machine

from . import flops
from .evaluate import begun

Row = dict[str, Any]
Timed = Callable[[], float]

BLOCK = 500
"""Steps of a single environment timed in one go."""
MANY = 1024
"""Environments in a batch."""
HIGH = 60.0
"""m: so far a car is lifted that is to stay in the air."""
SMALL = 0.02
"""Of the torque limits: what keeps a car awake, and does not move it."""
PHASES = ("in the air", "tumbling", "at rest, awake", "asleep")
STEPS = {"in the air": 25, "tumbling": 75, "at rest, awake": 25, "asleep": 25}
"""Environment steps from a start."""
PEER_STEPS = 10 * 75
"""MuJoCo's, from each start."""
PEER_STARTS = 8


def bench(rounds: int = 15, progress: Callable[[Iterable], Iterable] = iter) -> list[Row]:
    """Measure everything.

    Args:
        rounds: how often each figure is taken, in turns.
        progress: wraps the loop over figures.

    Returns:
        Rows with the figure, what of, its median, 10th and 90th percentile, unit, and how it was taken.
    """
    rows: list[Row] = []
    parts = [single, peer, batch, processor, gymnasiums, learning]
    for part in progress(parts):
        rows += part(rounds)
    return rows


def write(path: Path, rows: list[Row]) -> None:
    """Write rows, and what they were measured on, as CSV."""
    about = [{"figure": name, "of": value} for name, value in machine().items()]
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows([*rows, *about])


def _row(figure: str, of: str, values: Any, unit: str, how: str) -> Row:
    low, middle, high = np.percentile(values, [10, 50, 90])
    return {
        "figure": figure,
        "of": of,
        "median": float(f"{middle:.4g}"),
        "p10": float(f"{low:.4g}"),
        "p90": float(f"{high:.4g}"),
        "unit": unit,
        "how": how,
    }


def _turns(rounds: int, *timed: Timed) -> np.ndarray:
    """(rounds, len(timed)): what each took, in turns; once unseen, so that nothing compiles meanwhile."""
    for one in timed:
        one()
    return np.array([[one() for one in timed] for _ in range(rounds)])


def _actions(phase: str, n: int, rng: np.random.Generator) -> np.ndarray:
    limit = SMALL if phase in ("at rest, awake", "in the air") else 0.0
    return rng.uniform(-limit, limit, (n, 3)).astype(np.float32)


def _states(phase: str, n: int) -> np.ndarray:
    """(n, k) states in which cars begin a phase."""
    start = "upright" if "rest" in phase or phase == "asleep" else "drop"
    core = begun(np.arange(n), start=start)
    if phase == "in the air":
        core.states[:, r.MOTION + 2] += HIGH
    if phase in ("at rest, awake", "asleep"):  # let it settle
        core.rows[:, r.MOTION + 7 : r.MOTION + 13] = 0.0
        for _ in range(50):
            core.step(_actions(phase, n, np.random.default_rng(0)))
        core.rows[:, [r.STEPS, r.HELD]] = 0.0
    return core.states.copy()


# A single environment beside Gymnasium's best known.


def single(rounds: int) -> list[Row]:
    """CartPole-v1's step through `gym.make`, over FlipCar-v0's."""
    cartpole = gym.make("CartPole-v1")
    cartpole.reset(seed=0)
    flips = np.random.default_rng(0).integers(0, 2, BLOCK).tolist()

    def reference() -> float:
        spent = 0.0
        for flip in flips:
            before = time.perf_counter()
            _, _, terminated, truncated, _ = cartpole.step(flip)
            spent += time.perf_counter() - before
            if terminated or truncated:
                cartpole.reset()
        return spent / BLOCK

    policy = load_policy("nominal")
    rng = np.random.default_rng(0)
    noise = rng.uniform(-1, 1, (BLOCK, 3)).astype(np.float32)
    ways = {phase: _single(_states(phase, 20), _still(phase)) for phase in PHASES}
    ways["shipped policy"] = _single(None, lambda i, obs: policy(obs))
    ways["random torque"] = _single(None, lambda i, obs: noise[i])
    rows = []
    for name, timed in ways.items():
        times = _turns(rounds, reference, timed)
        how = f"gym.make, {BLOCK} environment steps a block; resets not timed"
        rows.append(_row("CartPole-v1 / FlipCar-v0", name, times[:, 0] / times[:, 1], "ratio", how))
        rows.append(_row("FlipCar-v0 step", name, 1e6 * times[:, 1], "µs an environment step", how))
    return rows


def _still(phase: str) -> Callable[[int, Any], np.ndarray]:
    actions = _actions(phase, BLOCK, np.random.default_rng(0))
    return lambda i, obs: actions[i]


def _single(states: np.ndarray | None, act: Callable[[int, Any], Any]) -> Timed:
    """Time a single environment's steps: from states in turn, or from starts of any kind."""
    env = gym.make("FlipCar-v0")
    env.reset(seed=0)
    length = 25

    def timed() -> float:
        spent = 0.0
        over = True
        obs = None
        for i in range(BLOCK):
            if over or (states is not None and i % length == 0):
                options = {} if states is None else {"state": states[(i // length) % len(states)]}
                obs, _ = env.reset(options=options)
            action = act(i, obs)
            before = time.perf_counter()
            obs, _, terminated, truncated, _ = env.step(action)
            spent += time.perf_counter() - before
            over = terminated or truncated
        return spent / BLOCK

    return timed


# Batches beside MuJoCo.


def _batch(phase: str, n: int = MANY, threads: int = 1, substeps: int = 10) -> Timed:
    """Seconds a substep of one car; whole environment steps, observation and reward included."""
    core = Core(n, threads=threads, control_dt=0.004 * substeps, substeps=substeps)
    states = _states(phase, n)
    actions = [_actions(phase, n, np.random.default_rng(i)) for i in range(STEPS[phase])]
    steps = max(1, STEPS[phase] * 10 // substeps)

    def timed() -> float:
        core.put_states(states, np.arange(n))
        before = time.perf_counter()
        for i in range(steps):
            core.step(actions[i])
        return (time.perf_counter() - before) / (n * steps * substeps)

    return timed


def _mujoco(phase: str) -> Timed:
    """Seconds a step of MuJoCo's rollout: the same hull, step, friction and starts, one thread."""
    import mujoco
    from mujoco import rollout

    body = car.body()
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.004
    spec.option.gravity = [0.0, 0.0, -9.81]
    spec.add_mesh(name="hull", uservert=body.hull.ravel())
    friction = [car.FRICTION, 0.005, 0.0001]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=friction)
    one = spec.worldbody.add_body(explicitinertial=True, mass=body.m, inertia=car.INERTIA)
    one.add_freejoint(name="free")
    one.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull", friction=friction)
    for axis in range(3):
        gear = np.zeros(6)
        gear[3 + axis] = car.TORQUE_LIMIT[axis]
        spec.add_actuator(target="free", trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=gear)
    model = spec.compile()
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = []
    for state in _states(phase, PEER_STARTS):
        data.qpos[:], data.qvel[:] = state[:7], state[7:13]
        if phase == "in the air":
            data.qpos[2] += 100.0  # three seconds of fall
        start = np.empty((1, mujoco.mj_stateSize(model, full)))
        mujoco.mj_getState(model, data, start[0], full)
        starts.append(start)
    torque = _actions(phase, PEER_STEPS, np.random.default_rng(0))[None].astype(float)

    def timed() -> float:
        before = time.perf_counter()
        for start in starts:
            rollout.rollout(model, [data], start, torque)
        return (time.perf_counter() - before) / (PEER_STARTS * PEER_STEPS)

    return timed


def peer(rounds: int) -> list[Row]:
    """MuJoCo's time for a step over ours for a substep, one core; and ours by itself."""
    rows = []
    how = f"{MANY} cars at once, environment steps of 10 substeps, observation and reward included"
    for phase in PHASES:
        timed = [_batch(phase), *([_mujoco(phase)] if find_spec("mujoco") else [])]
        times = _turns(rounds, *timed)
        rows.append(_row("time of a substep", phase, 1e9 * times[:, 0], "ns", how))
        rows.append(_row("substeps a second", phase, 1e-6 / times[:, 0], "million a core", how))
        if find_spec("mujoco"):
            note = "rollout of mujoco, defaults, the car's convex hull; it does not sleep. Ours: " + how
            rows.append(_row("MuJoCo / FlipCar", phase, times[:, 1] / times[:, 0], "ratio", note))
    return rows


# What batches cost and gain.


def batch(rounds: int) -> list[Row]:
    """Threads and memory."""
    one, two = _batch("tumbling", 4096), _batch("tumbling", 4096, threads=2)
    times = _turns(max(1, rounds // 2), one, two)
    row = Core(1).rows
    return [
        _row("two threads / one", "tumbling", times[:, 0] / times[:, 1], "ratio", "4096 cars"),
        _row("memory", "an environment", [row.nbytes], "bytes", "its row: state, results and observation"),
    ]


def processor(rounds: int) -> list[Row]:
    """Share of what the core could do in float64, measured in turns; operations counted from the source."""
    rows = []
    # a torque that stays the same for long would let a car at rest fall asleep
    for phase, count, substeps in (
        ("in the air", flops.flight(), 50),
        ("at rest, awake", flops.contact(4), 10),
    ):
        times = _turns(rounds, _batch(phase, substeps=substeps), lambda: flops.peak())
        share = count / times[:, 0] / times[:, 1]
        how = f"{count} operations a substep, {substeps} substeps a step; of sums of products in registers"
        rows.append(_row("share of the core's peak", phase, 100 * share, "%", how))
    rows.append(_row("peak", "one core, float64", times[:, 1] / 1e9, "GFLOP/s", "sums of products"))
    return rows


def gymnasiums(rounds: int) -> list[Row]:
    """Gymnasium's own benchmarks, random actions, resets included."""
    from gymnasium.utils.performance import benchmark_step, benchmark_vector_step

    def rate(name: str) -> float:
        return benchmark_step(gym.make(name), target_duration=1, seed=0)

    def vector_rate(name: str) -> float:
        env = gym.make_vec(name, num_envs=MANY, vectorization_mode="vector_entry_point")
        return benchmark_vector_step(env, target_duration=1, seed=0)

    rows = []
    for name, measure in (("benchmark_step", rate), ("benchmark_vector_step", vector_rate)):
        pairs = [(measure("FlipCar-v0"), measure("CartPole-v1")) for _ in range(max(1, rounds // 5))]
        ours, theirs = np.array(pairs).T
        how = "gymnasium.utils.performance" + (f", {MANY} environments" if "vector" in name else "")
        rows.append(_row(name, "FlipCar-v0", ours, "environment steps/s", how))
        rows.append(_row(name, "FlipCar-v0 / CartPole-v1", ours / theirs, "ratio", how))
    return rows


def learning(rounds: int) -> list[Row]:
    """Where the time of an SB3 PPO training goes, with `flipcar train`'s settings."""
    if not find_spec("stable_baselines3"):
        return []
    from .config import Config
    from .learner import learner

    config = Config()
    model = learner(config)
    spent = dict.fromkeys(("environment", "network in rollouts", "updates"), 0.0)

    def watch(owner: Any, method: str, part: str) -> None:
        original = getattr(owner, method)

        def timed(*args: Any, **kwargs: Any) -> Any:
            before = time.perf_counter()
            result = original(*args, **kwargs)
            spent[part] += time.perf_counter() - before
            return result

        setattr(owner, method, timed)

    watch(model.get_env().unwrapped, "step_wait", "environment")
    watch(model.policy, "forward", "network in rollouts")
    watch(model, "train", "updates")
    updates = max(1, rounds // 3)
    size = model.n_steps * model.n_envs
    model.learn(size)
    spent.update(dict.fromkeys(spent, 0.0))
    before = time.perf_counter()
    model.learn(updates * size, reset_num_timesteps=False)
    total = time.perf_counter() - before
    how = f"PPO as `flipcar train` has it, {model.n_envs} cars, {updates} updates of {size} steps"
    rows = [
        _row("share of a PPO training's time", part, [100 * s / total], "%", how) for part, s in spent.items()
    ]
    rest = 100 * (1 - sum(spent.values()) / total)
    rows.append(_row("share of a PPO training's time", "SB3's own Python", [rest], "%", how))
    rows.append(_row("PPO training", "all", [updates * size / total], "environment steps/s", how))
    return rows
