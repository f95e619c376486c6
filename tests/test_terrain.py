"""The grounds: starts touch them and go no deeper, energy does not grow, and every car can stand."""

import numpy as np
import pytest
from test_row import HULL, actions, begun

from flipcar_env import reward, starts, terrain
from flipcar_env import row as r
from flipcar_env.core import Core
from flipcar_env.env import FlipCarEnv
from solver import Body, Scene
from solver.scene import from_kernel


def gaps(row, ground):
    """(p,) distance of each hull point of a row's car to the ground, m."""
    hull = HULL[:, :3] - row[r.OFFSET : r.OFFSET + 3]
    body = Body(row[r.MASS], row[r.INERTIA : r.INERTIA + 3], hull, radius=HULL[:, 3])
    return Scene(body, terrain.surface(ground)).gap(from_kernel(body, row[None, :13]))[0]


def test_starts_touch_the_ground_or_are_clear_of_it_and_lie_with_it():
    n, ranges = 60, {"drop": (0.2, 1.5), "crash": (0.0, 0.5)}
    kinds = np.repeat(terrain.KINDS, n).tolist()
    core = Core(len(kinds), terrain=kinds, randomize=True)
    plain = Core(1)
    for start in starts.KINDS:
        begun(core, [start])
        deepest = np.array([gaps(row, ground).min() for row, ground in zip(core.states, kinds, strict=True)])
        low, high = ranges.get(start, (0.0, 0.0))
        assert (deepest >= low - 1e-9).all()
        assert (deepest <= high + 1e-9).all()
        places = core.states[:, :2].reshape(-1, n, 2)
        assert (places[0] == 0.0).all()
        assert len(np.unique(places[1:].reshape(-1, 2), axis=0)) == 3 * n
        assert (np.abs(places[1:]) < terrain.SCATTER + 1.0).all()  # a plane's starts lie along it
        assert (np.ptp(places[1:], axis=1) > terrain.SCATTER).all()
        # the car's axes meet the ground's normal on the slope as they meet the vertical on level ground
        for i in range(n):
            begun(plain, [start], seed=n + i)
            level, slope = (from_kernel(Body(1, (1, 1, 1), HULL[:, :3]), s[None, :13])
                            for s in (plain.states[0], core.states[n + i]))  # fmt: skip
            normal = terrain.surface("slope").normal
            for a, b in ((level.v, slope.v), (level.w, slope.w)):
                np.testing.assert_allclose(b @ normal, a[:, 2], atol=1e-12)
        tilt = core.results[:, r.TILT].reshape(-1, n)
        if start == "upright":
            assert tilt[0].max() < 1e-7
            np.testing.assert_allclose(tilt[1], terrain.SLOPE, rtol=1e-9)
            assert 0.05 < tilt[2:].max() < np.arctan(np.sqrt(3))


def test_a_car_on_its_wheels_stands_anywhere_and_succeeds():
    kinds = np.repeat([*terrain.KINDS, "ditch"], 40).tolist()
    core = Core(len(kinds), terrain=kinds, randomize=True)
    for ground in core.grounds:
        ground.model[r.SCATTER] *= 1.0 if kinds[ground.which[0]] == "ditch" else 25.0
    begun(core, ["upright"], seed=4)
    done = np.zeros(len(kinds), dtype=bool)
    for _ in range(150):
        core.step(np.zeros((len(kinds), 3), np.float32))
        done |= core.results[:, r.SUCCESS] != 0.0
    assert done.all()
    assert core.results[:, r.TILT].max() < np.radians(13.0)
    assert np.cos(np.radians(13.0)) > reward.COS_TILT
    assert np.abs(core.states[:, 7:13]).max() < 1e-6  # at rest, the least friction notwithstanding


def test_energy_grows_by_no_more_than_the_actuators_work():
    n, steps = 24, 250
    kinds = [terrain.KINDS[i % 4] for i in range(n)]
    core = begun(Core(n, terrain=kinds, randomize=True), np.repeat(starts.KINDS, 4).tolist(), seed=90)
    had, deepest = core.results[:, r.ENERGY] - core.states[:, r.WORK], 0.0
    for action in actions(steps, n):
        core.step(action)
        has = core.results[:, r.ENERGY] - core.states[:, r.WORK]
        assert (has <= had + 0.5).all()  # J, of tens of kJ
        had = has
        deepest = min(
            deepest, min(gaps(row, k).min() for row, k in zip(core.states[:4], kinds, strict=False))
        )
    assert deepest > -1e-6
    assert not core.results[:, r.FAILED].any()


def test_grounds_and_cars_of_all_kinds_in_one_batch_have_the_bits_of_each_alone():
    n, steps = 12, 120
    kinds = [terrain.KINDS[(i * 7) % 4] for i in range(n)]
    random = [i % 3 > 0 for i in range(n)]
    batch = begun(Core(n, terrain=kinds, randomize=random), starts.KINDS, seed=30)
    driven = actions(steps, n)
    alone = []
    for i in range(n):
        env = FlipCarEnv(terrain=kinds[i], randomize=random[i])
        obs, _info = env.reset(seed=30 + i, options={"start": starts.KINDS[i % 6]})
        np.testing.assert_array_equal(obs, batch.observed[i])
        alone.append(env)
    for t in range(steps):
        batch.step(driven[t])
        for i, env in enumerate(alone):
            obs, reward_, *_ = env.step(driven[t, i])
            np.testing.assert_array_equal(obs, batch.observed[i])
            assert reward_ == batch.results[i, r.REWARD]
            np.testing.assert_array_equal(env.get_state(), batch.states[i])
    before = batch.rows.copy()
    bad = driven[0].copy()
    bad[7, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        batch.step(bad)
    np.testing.assert_array_equal(batch.rows, before)


def test_height_is_above_the_ground():
    """A car deep in the ditch or far down the slope is not seen below it."""
    for ground in ("slope", "ditch"):
        env = FlipCarEnv(terrain=ground)
        env.reset(seed=0, options={"start": "upright"})
        state = env.get_state()
        x = (
            np.array([60.0, 0.0, -60.0 * np.tan(terrain.SLOPE)])
            if ground == "slope"
            else np.array([0, 0, -0.8])
        )
        normal = terrain.surface(ground).normal if ground == "slope" else np.array([0.0, 0.0, 1.0])
        state[:3] = x + 2.0 * normal
        obs, _info = env.reset(options={"state": state})
        assert obs[9] == pytest.approx(2.0, abs=1e-6)


def test_only_curved_ground_has_a_field():
    curved = [ground.surface.field is not None for ground in Core(4, terrain=terrain.KINDS).grounds]
    assert curved == [False, False, True, True]


@pytest.mark.parametrize("value", ["lava", ["level"], ["level", "level", "lava"], 3, None])
def test_terrain_is_a_name_or_one_for_each(value):
    with pytest.raises(ValueError, match="terrain"):
        Core(3, terrain=value)
