"""The kernels as plain Python: small scenes that run every line, obey their laws, and agree with JIT.

Run as a program it plays all scenes and writes what came of them:
`NUMBA_DISABLE_JIT=1 python tests/test_plain.py FILE.npz`.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

import coverage
import numpy as np
import pytest
from oracle import random_body, random_quat, turned

from solver import METHODS, Body, HeightField, Plane, Scene, SolverError, State, simulate
from solver.exact.impact import impact

ROOT = Path(__file__).parents[1]
UPRIGHT, ZERO = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
TILTED = turned([1.0, 2.0, 0.5], 0.7)

BOX = Body.box(1.0, (0.2, 0.3, 0.4))
ROUND_BOX = Body.box(1.0, (0.2, 0.3, 0.4), radius=0.02)
SLAB = Body.box(1.0, (0.2, 0.2, 0.1))
BALL = Body.sphere(1.0, 0.1)
ROD = Body.rod(1.0, 2.0)
LOPSIDED = Body(1.0, (0.004, 0.004, 0.004), [(0, 0, -0.02)], radius=0.1)
TOP = Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.1)])
TRIPOD = Body(1.0, (0.01, 0.02, 0.025), [(0.2, 0, -0.1), (-0.2, 0.15, -0.1), (-0.2, -0.15, -0.1)])
SLOPE = Plane((0.3, 0.1, 1.0))
BUMPS = HeightField.named("bumpy", height=0.1, size=6.0, seed=3)
DITCH = HeightField.named("ditch")

GAIN = {"acceleration": 1e-2, "baumgarte": 1e-2, "impulse": 2e-5, "exact": 1e-11}
"""J; by how much a method's energy may rise in a record: the first two are of first order."""

SINK = {"acceleration": 1e-2, "baumgarte": 1e-2, "impulse": 1e-6, "exact": 1e-12}
"""m; how deep a hull point may be."""


def on(scene, height=0.0, quat=UPRIGHT, v=ZERO, w=ZERO, at=(0.3, 0.2)):
    """A scene, and its body with the lowest point `height` above the surface."""
    x = np.array([*at, 1.0])
    for _ in range(60):
        x[2] += height - scene.gap(State(x, quat, v, w)).min()
    return scene, State(x, quat, v, w)


def lawful(scene, state, duration, method="impulse", dt=1 / 60, torque=ZERO, **more):
    """The motion (T, 13) of a run; it is finite, above ground, and gains no more than the torque's work."""
    run = simulate(scene, state, duration, dt, method, torque=torque, **more)
    motion = np.concatenate([run.x, run.quat, run.v, run.w], -1)
    assert np.isfinite(motion).all()
    assert np.isfinite(run.f).all()
    assert (run.f >= 0).all()
    spin = np.linalg.norm(run.w, axis=-1)
    work = 2 * dt * np.linalg.norm(torque) * np.maximum(spin[1:], spin[:-1])
    assert (np.diff(run.energy, axis=0) <= GAIN[method] + work).all()
    gaps = [scene.gap(State(*rows)) for rows in zip(run.x, run.quat, run.v, run.w, strict=True)]
    assert np.min(gaps[1:]) >= -SINK[method]
    return motion


SCENES = {
    # impulse
    "a tossed box comes to rest": lambda: lawful(
        *on(Scene(BOX, friction=0.5, restitution=0.3), 0.1, TILTED, [1, 0.5, 0], [3, 1, 2]), 1.0
    ),
    "a block slides to a stop": lambda: lawful(
        *on(Scene(SLAB, friction=0.5), v=[0.3, 0.1, 0], w=[0, 0, 1]), 0.2
    ),
    "a ball bounces more often than a step has impacts": lambda: lawful(
        *on(Scene(BALL, restitution=0.9), 0.001), 0.6, dt=0.1
    ),
    "a box lies still": lambda: lawful(*on(Scene(BOX, friction=0.5)), 0.3),
    "a box falls flat on ice": lambda: lawful(*on(Scene(BOX, restitution=0.5), 0.05, v=[1, 0, 0]), 0.3),
    "a ball under a torque": lambda: lawful(
        *on(Scene(BALL, SLOPE, friction=0.3, restitution=0.2), 0.02), 0.3, torque=[0.1, 0.2, 0.0]
    ),
    "a box high up under a torque": lambda: lawful(
        *on(Scene(BOX), 3.0, w=[0, 5, 0.1]), 0.1, torque=[0.1, 0.02, 0.3]
    ),
    "a box spins fast over the ground": lambda: lawful(
        *on(Scene(BOX, friction=0.2, restitution=0.2), 0.02, TILTED, ZERO, [80, 40, 45]), 0.1
    ),
    "a rod beyond Painlevé's limit": lambda: lawful(
        *on(Scene(ROD, friction=3.0), 0.0, turned([0, 1, 0], 0.9), [-3, 0, 0]), 0.2
    ),
    "a top": lambda: lawful(*on(Scene(TOP), w=[1, 0.5, 60], v=[0, 0, -0.03]), 0.1, dt=1 / 240),
    "a round body skids": lambda: lawful(
        *on(Scene(LOPSIDED, friction=0.1), 0.0, turned([1, 0, 0], 0.6), [1, 0.3, 0], [20, -5, 10]), 0.1
    ),
    "a box tumbles over bumps": lambda: lawful(
        *on(Scene(ROUND_BOX, BUMPS, friction=0.5, restitution=0.3), 0.02, TILTED, [2, 1, 0], [3, -5, 2]), 0.5
    ),
    "a box comes to rest on bumps": lambda: lawful(*on(Scene(BOX, BUMPS, friction=0.8), 0.0, TILTED), 0.3),
    "a tripod slides on bumps": lambda: lawful(*on(Scene(TRIPOD, BUMPS, friction=0.1), v=[1, 0, 0]), 0.3),
    "a ball in a ditch": lambda: lawful(*on(Scene(BALL, DITCH, friction=0.3), v=[2, 0.5, 0]), 0.3),
}


def scene(play):
    """Add a function's scene, under its name."""
    SCENES[play.__name__.replace("_", " ")] = play
    return play


@scene
def a_box_holds_near_the_friction_angle_exactly():
    """There equal shares of friction would leave the cones of the points that carry little."""
    theta = np.arctan(0.45)
    normal = np.array([np.sin(theta), 0, np.cos(theta)])
    held = Scene(Body.box(1.0, (1, 1, 0.4)), Plane(normal), friction=0.5)
    return lawful(held, State(0.2 * normal, turned([0, 1, 0], theta), ZERO, ZERO), 0.1, "exact", dt=0.1)


@scene
def a_box_on_its_deepest_point_alone():
    """Several contacts left out: other points sink, so the laws do not hold."""
    lean, start = on(Scene(BOX, friction=0.5, restitution=0.3), 0.05, TILTED, w=[1, 2, 0])
    lean.law = (0.5, 0.3, None, None, None, 0.4)
    run = simulate(lean, start, 0.4, 1 / 60)
    return np.concatenate([run.x, run.quat, run.v, run.w], -1)


@scene
def random_tosses():
    """Any body, any ground, any law: a few steps each."""
    rng = np.random.default_rng(1)
    motion = []
    for i in range(36):
        body = (BOX, ROUND_BOX, ROD, TRIPOD, LOPSIDED, random_body(rng, 3))[i % 6]
        ground = (Plane(), SLOPE, BUMPS, DITCH)[i % 4]
        law = {"friction": rng.choice([0.0, 0.1, 0.5, 1.0, 3.0]), "restitution": rng.choice([0.0, 0.5, 1.0])}
        start = on(
            Scene(body, ground, **law), rng.choice([0, 0, 0.01]), random_quat(rng),
            rng.normal(size=3) * 10 ** rng.uniform(-2, 1), rng.normal(size=3) * 10 ** rng.uniform(-2, 1.5),
            rng.uniform(-1, 1, 2),
        )  # fmt: skip
        motion.append(lawful(*start, 6 / 240, dt=1 / 240))
    return np.array(motion)


@scene
def random_blows():
    """One impact each, by the path of Eq. 12 and by Newton's law."""
    rng = np.random.default_rng(2)
    motion = []
    for i in range(40):
        law = {"friction": rng.uniform(0, 3), "restitution": rng.choice([0, 0.5, 1.0])}
        ground = Scene(random_body(rng), (Plane(), SLOPE)[i % 2], **law)
        start = on(
            ground, 0.0, random_quat(rng), rng.normal(size=3) * 10 ** rng.uniform(-1, 1, 3),
            rng.normal(size=3),
        )  # fmt: skip
        for method in ("impulse", "exact"):
            motion.append(lawful(*start, 1e-6, method, dt=1e-6))
    return np.array(motion)


for method in ("acceleration", "baumgarte"):
    for name, start in {
        "a box drops": lambda: on(Scene(ROUND_BOX, BUMPS, restitution=0.3), 0.01, TILTED),
        "a ball falls on ice": lambda: on(Scene(BALL, SLOPE, restitution=0.3), 0.01, v=[1, 0, 0]),
        "a ball skids": lambda: on(Scene(LOPSIDED, friction=0.1), 0.0, TILTED, [1.0, 0.3, 0]),
        "a ball in a ditch": lambda: on(Scene(BALL, DITCH, friction=0.1), v=[2, 0.5, 0], at=(-0.5, 0)),
        "a top": lambda: on(Scene(TOP), w=[1, 0.5, 20], v=[0, 0, -0.03]),
    }.items():
        SCENES[f"{name}, by {method}"] = lambda start=start, method=method: lawful(
            *start(), 0.15, method, dt=1 / 480
        )


@scene
def random_impacts():
    """Eq. 12's path for bodies of all kinds: no gain, inside the cone, no closing left."""
    rng = np.random.default_rng(4)
    impulses = []
    for _ in range(150):
        inertia = rng.uniform(size=3) ** 3
        arms = np.cross(rng.normal(size=3), np.eye(3))
        K = np.eye(3) + arms @ np.diag(1 / (inertia.sum() - inertia)) @ arms.T
        u = rng.normal(size=3) * 10 ** rng.uniform(-3, 1, 3)
        u[0] = -abs(u[0])
        mu, e = rng.uniform(0, 3), rng.choice([0.0, 0.5, 1.0])
        *p, ok = impact((K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2], K[2, 2]), mu, e, tuple(u))
        p = np.array(p)
        assert ok
        assert p @ (u + 0.5 * K @ p) <= 1e-12 * (u @ u)
        assert np.hypot(p[1], p[2]) <= mu * p[0] * (1 + 1e-12)
        assert (u + K @ p)[0] >= -1e-10 * np.linalg.norm(u)
        impulses.append(p / np.linalg.norm(p))
    return np.array(impulses)


@scene
def no_impulse_where_there_is_no_impact():
    """Nothing closes, or no body has such a K."""
    ball = (1.0, 0.0, 0.0, 3.5, 0.0, 3.5)
    assert impact(ball, 0.5, 0.5, (0.0, 1.0, 0.0)) == (0.0, 0.0, 0.0, True)
    assert impact(ball, 0.5, 0.5, (np.nan, 1.0, 0.0)) == (0.0, 0.0, 0.0, False)
    for K, u in (
        ((1.0, 3.0, 0.0, 1.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
        ((1.0, 3.0, 0.0, 1.0, 0.0, 1.0), (-1.0, 1.0, 0.0)),
        ((1.0, 3.0, 0.0, 1.0, 0.0, 1.0), (-1.0, 1.0, 0.1)),
    ):
        assert not impact(K, 0.9, 0.5, u)[3]
    return np.zeros(1)


@scene
def a_point_dips_between_the_ends_of_a_step():
    """It swings through the lowest, or turns back at once, by more and by less than its cubic says."""
    motion = []
    h, theta = 1 / 60, 0.23
    for side, pull, deeper in ((-1, 0.0, 1e-3), (-1, 0.0, 1e-6), (1, 200.0, 1e-3), (1, 200.0, -6e-6)):
        scene = Scene(Body(1.0, (1, 1, 1), [(0, 0, 0.1 * side)]), gravity=(0, 0, pull))
        sag = pull * h * h / 8 - side * 0.1 * (1 - np.cos(theta))
        start = on(
            scene, sag - deeper, turned([0, 1, 0], -theta), [0, 0, -pull * h / 2], [0, 2 * theta / h, 0]
        )
        motion.append(lawful(*start, 3 * h, dt=h))
    return np.array(motion)


@scene
def painleves_rod_has_no_force():
    """Eq. 11 has no answer: said at the start, and where the rod has turned so far."""
    for tilt, w in ((0.9, ZERO), (0.2, [0.0, 3.0, 0.0])):
        scene, state = on(Scene(ROD, friction=3.0), 0.0, turned([0, 1, 0], tilt), [3, 0, 0], w)
        closing = scene.contact(state).v[scene.gap(state).argmin()]
        start = scene, State(state.x, state.quat, state.v - [0, 0, closing], w)
        for method in ("acceleration", "baumgarte"):
            with pytest.raises(SolverError, match="Painlevé"):
                simulate(*start, 0.3, method=method, record_every=100)
    return np.zeros(1)


@scene
def eq_8_every_frame():
    start = on(Scene(TOP), w=[1, 0.5, 20], v=[0, 0, -0.03])
    return lawful(*start, 0.1, "acceleration", dt=1 / 480, options={"every_frame": True})


@scene
def the_articles_numbers():
    """Eqs. 4-8 agree with each other: f = −l/G and i = −(1 + e) v/G."""
    all_of = []
    for ground in (SLOPE, BUMPS):
        scene, state = on(Scene(BOX, ground, restitution=0.5), 0.0, TILTED, [1, 2, -3], [1, 2, 3])
        c = scene.contact(state, torque=(0.1, 0.2, 0.3))
        np.testing.assert_allclose(c.f, np.maximum(0, -c.l / c.G), rtol=1e-12)
        np.testing.assert_allclose(c.i, np.maximum(0, -1.5 * c.v / c.G), rtol=1e-12)
        all_of += [c.gap, c.v, c.G, c.l]
    return np.array(all_of)


@scene
def what_is_not_finite_is_reported():
    high, low = on(Scene(BALL), 5.0, v=[1e308, 0, 0]), on(Scene(BALL, friction=0.5), v=[1e308, 0, -1e200])
    for method in METHODS:
        with pytest.raises(SolverError, match="finite"):
            simulate(*high, 1.0, dt=0.5, method=method, force=(1e300, 0, 0))
    for method, start, torque in (
        ("impulse", low, ZERO),
        ("impulse", on(Scene(BOX), 5.0, w=[1e9, 1, 1]), ZERO),
        ("exact", on(Scene(BOX), 5.0), [1e300, 0, 0]),
    ):
        with pytest.raises(SolverError, match="finite"):
            simulate(*start, 1.0, dt=0.5, method=method, torque=torque)
    return np.zeros(1)


@scene
def several_points_on_curved_ground_are_too_many_for_exact():
    for height in (0.0, 0.01):
        start = on(Scene(SLAB, HeightField([[0, 0], [0, 0]], 1.0)), height)
        with pytest.raises(SolverError, match="one touching point"):
            simulate(*start, 0.5, method="exact")
    return np.zeros(1)


@scene
def a_free_spin_keeps_energy_and_momentum():
    """On either side of the separatrix and on it, and about an axis; exactly and in steps."""
    motion = []
    for J, w in (
        ((1.0, 2.5, 3.0), (1.0, 0.5, 1.0)),
        ((1.0, 2.0, 2.5), (-9.0, 1.0, 0.5)),
        ((2.5, 2.0, 1.0), (1.0, 5.0, -0.1)),
        ((2.0, 1.0, 2.5), (-0.1, 5.0, -6.0)),
        ((2.0, 2.0, 2.5), (0.0, 0.0, 4.0)),
        ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
    ):
        scene = Scene(Body(1.0, J, [(0, 0, 0.1)]), gravity=ZERO)
        for method, quat in (("impulse", UPRIGHT), ("exact", UPRIGHT), ("exact", TILTED)):
            run = simulate(scene, State([0, 0, 5.0], quat, ZERO, w), 6.0, dt=0.2, method=method)
            L = scene.angular_momentum(State(run.x, run.quat, run.v, run.w))
            np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-9)
            np.testing.assert_allclose(L, np.broadcast_to(L[0], L.shape), rtol=1e-12, atol=1e-12)
            motion.append(np.concatenate([run.quat, run.w], -1))
    return np.array(motion)


for name, (start, duration) in {
    "a box falls flat": (lambda: on(Scene(BOX, friction=0.3, restitution=0.5), 0.02, v=[0.5, 0, 0]), 0.2),
    "a lying rod slides to a stop": (
        lambda: on(Scene(ROD, friction=0.5), v=[0.03, 0.01, 0], w=[0, 0, 0.05]),
        0.02,
    ),
    "a lying rod is let go": (
        lambda: on(Scene(ROD, SLOPE, friction=0.2), quat=turned([0, 1, 0], 0.29)),
        0.05,
    ),
    "a rod beyond Painlevé's limit": (
        lambda: on(Scene(ROD, friction=3.0), 0.0, turned([0, 1, 0], 0.9), [3, 0, 0]),
        0.2,
    ),
    "a tossed box": (
        lambda: on(Scene(BOX, friction=0.5, restitution=0.2), 0.02, TILTED, [1, 0, 0], [3, 1, 2]),
        0.07,
    ),
    "a block topples back": (
        lambda: on(Scene(Body.box(1.0, (0.2, 0.2, 0.6)), friction=5.0), 0.0, turned([0, 1, 0], 0.16)),
        0.4,
    ),
    "a block slides to a stop": (lambda: on(Scene(BOX, friction=0.5), v=[0.3, 0, 0]), 0.1),
    "two corners of a box jam": (
        lambda: (
            Scene(
                Body.box(1.0, (0.4200770307574021, 0.25844217968992633, 0.44330740137439095)),
                friction=2.0,
                restitution=0.2,
            ),
            State(
                [1.3662221176246236, 0.2121648421659295, 0.23915350992787798],
                [-0.456659509653818, 0.049945024937274395, -0.7053403190380503, -0.5398727822978769],
                [-0.03752663308023225, 0.02156205313152903, 0.019533273258920056],
                [-0.12511837383319885, -0.18485687271219967, -0.04659793188322153],
            ),
        ),
        0.004,
    ),
    "a ball bounces on ice": (lambda: on(Scene(BALL, SLOPE, restitution=0.5), 0.02), 0.4),
    "a ball falls into a ditch": (lambda: on(Scene(BALL, DITCH), 3.0, at=(0.1, 0)), 0.1),
    "a ball falls up": (lambda: on(Scene(BALL, gravity=(0, 0, 9.81)), 1.0, v=[0, 0, -2]), 0.4),
    "a top": (lambda: on(Scene(TOP), w=[1, 0.5, 60], v=[0, 0, -0.03]), 0.1),
    "a ball slides, then rolls": (lambda: on(Scene(BALL, friction=0.5), v=[0.3, 0.1, 0]), 0.1),
    "a ball skids in a ditch": (lambda: on(Scene(BALL, DITCH, friction=0.3), v=[2, 0.5, 0]), 0.03),
    "a ball bounces on bumps": (lambda: on(Scene(BALL, BUMPS, friction=0.3, restitution=0.5), 0.05), 0.4),
    "a ball bounces to rest": (lambda: on(Scene(BALL, friction=0.3, restitution=0.3), 0.02), 0.4),
}.items():
    SCENES[f"{name}, exactly"] = lambda start=start, duration=duration: lawful(*start(), duration, "exact")


@scene
def a_torque_is_switched_exactly():
    """In flight, at a landing, and on the ground."""
    motion = []
    for body, height, torque in (
        (TOP, 0.01, lambda t: [0.1, 0.02, 0.1]),
        (BALL, 0.0, lambda t: [0.0, 0.02, 0.01] if t < 0.05 else ZERO),
        (BALL, 0.3, lambda t: [0.0, 0.02, 0.01] if t < 0.05 else ZERO),
    ):
        start = on(Scene(body, friction=0.3), height)
        run = simulate(*start, 0.1, dt=0.02, method="exact", torque=torque)
        assert start[0].gap(State(run.x, run.quat, run.v, run.w)).min() > -1e-12
        motion.append(np.concatenate([run.x, run.quat, run.v, run.w], -1))
    return np.array(motion)


@scene
def a_car_is_driven():
    """Every kind of start and observation; what a step adds to the energy is the actuator's work."""
    from flipcar_env import load_policy, observe, starts
    from flipcar_env.env import FlipCarEnv

    policy = load_policy("nominal")
    seen = []
    for obs_kind, ground in zip(observe.KINDS, ("level", "level", "ditch", "level"), strict=True):
        env = FlipCarEnv(obs=obs_kind, terrain=ground, randomize=ground != "level", substeps=4)
        for i, start in enumerate((*starts.KINDS, "any")):
            obs, info = env.reset(seed=i, options={"start": start})
            long = 80 if ground == "ditch" else 14  # there it has to settle first
            before, steps = info["energy"], long if start == "upright" else 2
            for _ in range(steps):
                action = policy(obs) if obs_kind == policy.obs and start != "upright" else np.zeros(3)
                obs, total, _terminated, _truncated, info = env.step(action)
                assert env.observation_space.contains(obs)
                assert total == pytest.approx(sum(info["reward_terms"].values()))
                assert info["energy"] <= before + info["work"] + 1e-3 * before
            assert info["is_success"] == (start == "upright")
            if start not in ("roof", "side", "any"):
                seen.append(np.resize(obs, 13))
    again = env.get_state()
    env.reset(options={"state": again})
    np.testing.assert_array_equal(env.get_state(), again)
    with pytest.raises(ValueError, match="action"):
        env.step(np.full(3, np.nan))
    return np.array(seen, float)


@scene
def a_car_of_its_own_settles():
    """A randomised car, late and noisy; and, in place of minutes, a moment of one that is laid down."""
    from flipcar_env import settle
    from flipcar_env.env import FlipCarEnv

    for obs in ("egocentric", "state"):
        env = FlipCarEnv("drop", "slope", randomize=True, obs=obs, action_delay=2, sensor_noise=1.0)
        env.reset(seed=0)
        env.step(np.ones(3))
    settle.SETTLE_TIME, settle.STILL = 0.04, 100.0
    return np.concatenate([env.get_state(), settle.settle(1).ravel()])


@scene
def a_car_is_drawn():
    """On a plane and on a height field: small, as each node and pixel takes its time here."""
    from flipcar_env import picture, terrain
    from flipcar_env.core import Core

    picture._offsets = lambda: np.arange(-6.0, 7.0) ** 3 / 12
    core = Core(2, start="upright", terrain=("level", "ditch"))
    core.begin(np.arange(2))
    pictures = [
        picture.draw(core.states[i : i + 1], terrain.surface(ground), 48, 36)
        for i, ground in enumerate(core.terrains)
    ]
    return np.concatenate([np.ravel(pictures), terrain.surface("ditch").heights([0.0, 1.0], [0.5, 2.0])])


# What the scenes miss: (file, function, line).
GUARDS = {  # against what no caller passes, loops without end, and failures further down
    ("flipcar_env/task.py", "drive_alone", "return"),
    ("flipcar_env/task.py", "drive_alone", "row[r.STATE + r.FAILED] = 1.0"),
    ("solver/exact/decide.py", "decide", "return OK"),
    ("solver/exact/flight.py", "march", "lowest, touched = z, k"),
    ("solver/exact/flight.py", "march", "return t_max, -1, evaluations"),
    ("solver/exact/impact.py", "_error", "return inf"),
    ("solver/exact/impact.py", "_event", "new = 0.5 * (low + high)"),
    ("solver/exact/impact.py", "_event", "return False, t, p, work"),
    ("solver/exact/impact.py", "_slide", "return _FAILED, p, u, store"),
    ("solver/exact/run.py", "resolve", "return STUCK"),
    ("solver/exact/run.py", "run", "return STUCK"),
    ("solver/exact/run.py", "run", "return flag"),
}
ROUNDING = {  # taken only where rounding, or an iteration that does not converge, asks for it
    ("solver/exact/impact.py", "impact", "unit *= spent / needed"),
    ("solver/impulse.py", "locate", "break"),
}
RARE = {  # reached by motions of which no scene is known that is small enough for plain Python
    ("solver/exact/impact.py", "_line", "return False, room, store - room * (u_n + 0.5 * D * room)"),
    ("solver/exact/run.py", "rests", "return False"),
    ("solver/exact/segment.py", "reverses", "return True"),
    ("solver/exact/segment.py", "segment", "continue"),
    ("solver/exact/segment.py", "segment", "return JAM, t, h"),
    ("solver/exact/segment.py", "segment", "step *= 0.5"),
    ("solver/impulse.py", "descent", "break"),
    ("solver/kick.py", "hold", "for c in range(int(largest(n))):"),
    ("solver/kick.py", "hold", "put2(rows, c, P, where(cold, NOTHING, vec2(rows, c, P)))"),
    ("solver/kick.py", "hold", "v1, w1 = where(cold, (v2, w2), (v1, w1))"),
    (
        "solver/kick.py",
        "hold",
        "v2, w2, _left = agree(rows, n, inv_m, mu, several, 1.0, 1.0, cold, v_b, w, STRIKE_SWEEPS, enough)",
    ),
}
EXEMPT = GUARDS | ROUNDING | RARE

# Lanes are there only where compiled; tests/test_vector.py compares them bit by bit.
LANES = {
    ("flipcar_env/task.py", function)
    for function in ("kind_of", "sort", "enter", "leave", "count_down", "step_many")
} | {("solver/kick.py", "again")}
LANES_FILES = ("solver/lanes.py", "solver/trace.py")


def plain(folder):
    """What the scenes come to without JIT, by name; and what they miss: {(file, line's text)}."""
    subprocess.run(
        [
            sys.executable, "-m", "coverage", "run", "--rcfile=", "--source=solver,flipcar_env",
            f"--data-file={folder / 'lines'}", __file__, str(folder / "motion.npz"),
        ],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        cwd=ROOT, check=True,
    )  # fmt: skip
    lines = coverage.Coverage(data_file=folder / "lines", config_file=False)
    lines.exclude("@intrinsic")
    lines.load()
    missed = set()
    for file in (*ROOT.glob("solver/*.py"), *ROOT.glob("solver/exact/*.py"), *ROOT.glob("flipcar_env/*.py")):
        text = file.read_text()
        kernels = kernel_lines(text)
        if kernels:
            name, rows = file.relative_to(ROOT).as_posix(), text.splitlines()
            numbers = kernels.keys() & lines.analysis2(str(file))[3]
            missed |= {
                (name, kernels[n], rows[n - 1].strip())
                for n in numbers
                if name not in LANES_FILES and (name, kernels[n]) not in LANES
            }
    return dict(np.load(folder / "motion.npz")), missed


def kernel_lines(text):
    """{number: function} of the lines inside functions that are compiled."""
    return {
        number: node.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef)
        and any(
            isinstance(d, ast.Name) and d.id in ("traced", "jit", "stage", "entry")
            for d in node.decorator_list
        )
        for number in range(node.lineno, node.end_lineno + 1)
    }


# Each scene that differs in its terms compiles kernels of its own: with JIT a few must do.
COMPILED = (
    "a round body skids",
    "a ball skids, by acceleration",
    "a ball skids, by baumgarte",
    "a ball slides, then rolls, exactly",
    "random impacts",
)


def test_plain_python_agrees_and_runs_every_line_of_every_kernel(tmp_path):
    motion, missed = plain(tmp_path)
    for name in COMPILED:
        np.testing.assert_allclose(motion[name], SCENES[name](), rtol=1e-9, atol=1e-9, err_msg=name)
    not_run, run_though_exempt = missed - EXEMPT, EXEMPT - missed
    assert not not_run
    assert not run_though_exempt


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        np.savez(sys.argv[1], **{name: play() for name, play in SCENES.items()})
