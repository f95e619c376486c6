"""FlipCar-v0: Gymnasium's and SB3's contracts, determinism, state, reward, and each kind of start."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import flipcar_env  # noqa: F401
from flipcar_env import car, observe, reward, starts
from flipcar_env.env import FlipCarEnv
from flipcar_env.rollout import play

FORWARD = np.array([0.7, -0.2, 0.1], np.float32)


def run(env, steps, seed=None, options=None):
    """The concatenated bits of an episode's observations and rewards under a fixed action pattern."""
    obs, _ = env.reset(seed=seed, options=options)
    seen = [obs]
    for i in range(steps):
        obs, r, terminated, truncated, _ = env.step(FORWARD * np.cos(0.1 * i))
        seen.append(np.append(obs, np.float32(r)))
        if terminated or truncated:
            break
    return np.concatenate(seen)


@pytest.mark.parametrize("obs", observe.KINDS)
def test_gymnasium_and_sb3_find_nothing_to_complain_about(obs):
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make("FlipCar-v0", obs=obs).unwrapped)
        sb3_check_env(gym.make("FlipCar-v0", obs=obs).unwrapped)


@pytest.mark.parametrize("start", [*starts.KINDS, "any"])
def test_every_start_is_new_clear_of_the_ground_and_what_it_says(start):
    env = FlipCarEnv(start=start)
    poses, tilts = [], []
    for i in range(40):
        obs, info = env.reset(seed=7 if i == 0 else None)
        assert env.observation_space.contains(obs)
        assert info["is_success"] is False
        poses.append(env.get_state()[:13])
        tilts.append(np.degrees(info["tilt"]))
        assert start == "any" or info["start"] == start
    assert len(np.unique(np.round(poses, 9), axis=0)) == 40
    from solver import Scene, State

    scene = Scene(car.body())
    poses = np.array(poses)
    gaps = scene.gap(State(poses[:, :3], poses[:, 3:7], poses[:, 7:10], poses[:, 10:13])).min(axis=1)
    assert gaps.min() > -1e-9
    low, high = {
        "roof": (120, 180), "side": (60, 120), "nose": (70, 110), "upright": (0, 1),
    }.get(start, (0, 180))  # fmt: skip
    assert min(tilts) >= low
    assert max(tilts) <= high
    if start in ("roof", "side", "upright"):
        np.testing.assert_allclose(gaps, 0, atol=1e-9)
        assert (np.diff(np.sort(tilts)) > 0).sum() < 40  # few facets, many nudges


def test_resting_starts_really_rest():
    """Left alone without the nudge, the car stays where it settled."""
    env = FlipCarEnv()
    for start in ("roof", "side"):
        env.reset(seed=1, options={"start": start})
        state = env.get_state()
        state[7:13] = 0.0
        env.set_state(state)
        for _ in range(100):
            env.step(np.zeros(3, np.float32))
        np.testing.assert_allclose(env.get_state()[3:7], state[3:7], atol=1e-4)


def test_the_same_seed_gives_the_same_bits():
    alone = [run(FlipCarEnv(), 60, seed=5 + i) for i in range(4)]
    again = [run(gym.make("FlipCar-v0"), 60, seed=5 + i) for i in range(4)]
    for a, b in zip(alone, again, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_restored_state_lives_the_same_future_and_times_out_at_the_same_step():
    env = FlipCarEnv()
    env.reset(seed=3, options={"start": "roof"})
    for i in range(100):
        env.step(FORWARD * np.cos(0.1 * i))
    state = env.get_state()

    def future(env):
        seen = []
        for _ in range(200):
            obs, r, terminated, truncated, info = env.step(FORWARD)
            seen.append(np.append(obs, [r, info["work"], info["energy"]]))
            if terminated or truncated:
                break
        obs, _ = env.reset()
        return [*seen, obs]

    first = future(env)
    other = FlipCarEnv(start="side")  # anything: the state holds all
    other.set_state(state)
    other.core.kinds = env.core.kinds
    second = future(other)
    assert len(first) == len(second) == 151
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
    obs, _ = env.reset(options={"state": state})
    np.testing.assert_array_equal(env.get_state(), state)


@pytest.mark.parametrize(
    "bad", [[np.nan, 0, 0], [0, np.inf, 0], [0, 0], [[0, 0, 0]], "left", "123", [1j, 0, 0], None]
)
def test_a_bad_action_is_refused_and_changes_nothing(bad):
    env = FlipCarEnv()
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(ValueError):
        env.step(bad)
    np.testing.assert_array_equal(env.get_state(), before)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"start": "moon"}, ["start", "'roof'", "moon"]),
        ({"terrain": "lava"}, ["terrain", "'level'", "lava"]),
        ({"obs": "smell"}, ["obs", "'egocentric'", "smell"]),
        ({"method": "magic"}, ["method", "'impulse'", "magic"]),
        ({"method": "acceleration"}, ["method", "'impulse'", "acceleration"]),
        ({"control_dt": 0}, ["control_dt", "> 0"]),
        ({"substeps": 0}, ["substeps", "1 to 1000", "0"]),
        ({"render_mode": "hologram"}, ["render_mode", "hologram"]),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(ValueError) as caught:
        FlipCarEnv(**arguments)
    for word in words:
        assert word in str(caught.value)


def test_bad_states_and_options_are_named_and_change_nothing():
    env = FlipCarEnv()
    with pytest.raises(gym.error.ResetNeeded):
        env.step(FORWARD)
    env.reset(seed=0)
    state = env.get_state()
    wrong = state.copy()
    wrong[3] = 2.0
    for bad, word in [(state[:-1], "shape"), (wrong, "norm 1"), (state * np.nan, "finite")]:
        with pytest.raises(ValueError, match=word):
            env.set_state(bad)
        with pytest.raises(ValueError, match=word):
            env.reset(options={"state": bad})
    with pytest.raises(ValueError, match="moon"):
        env.reset(options={"start": "moon"})
    with pytest.raises(ValueError, match="both"):
        env.reset(options={"start": "roof", "state": env.get_state()})
    with pytest.raises(ValueError, match="colour"):
        env.reset(options={"colour": "red"})
    np.testing.assert_array_equal(env.get_state(), state)


def test_seeds_that_are_none_are_named_and_huge_actions_are_clipped():
    env = FlipCarEnv()
    for bad in (-1, 0.5):
        with pytest.raises(ValueError, match="seed"):
            env.reset(seed=bad)
    env.reset(seed=np.int64(3))
    env.step(np.full(3, 3e38, np.float32))


def test_actions_are_clipped_and_torque_acts_about_the_cars_axes():
    env = FlipCarEnv()
    for action in ([1, 0, 0], [0, 1, 0], [0, 0, 1]):
        env.reset(seed=0, options={"start": "drop"})
        state = env.get_state()
        state[2] = 50.0
        state[7:13] = 0.0
        env.set_state(state)
        env.step(np.array(action, np.float32))
        axis = int(np.argmax(action))
        expected = car.TORQUE_LIMIT[axis] * 0.04 / car.INERTIA[axis]
        assert env.get_state()[10 + axis] == pytest.approx(expected, rel=1e-6)
        after = env.get_state()
        env.set_state(state)
        env.step(5 * np.array(action, np.float32))
        np.testing.assert_array_equal(env.get_state()[:13], after[:13])


def test_reward_is_the_sum_of_its_terms_and_turning_there_and_back_pays_nothing():
    env = FlipCarEnv()
    episode = play(env, lambda obs: FORWARD, seed=1, options={"start": "drop"})
    total = sum(episode.reward_terms[name] for name in reward.TERMS)
    np.testing.assert_allclose(episode.reward, total, atol=1e-12)
    up = 0.5 * (1 + np.cos(episode.tilt))
    progress = episode.reward_terms["progress"].sum()
    assert progress == pytest.approx(reward.PROGRESS * (up[-1] - up[0]), abs=1e-9)


def test_upright_succeeds_after_half_a_second_and_lying_still_never_does():
    env = FlipCarEnv()
    zero = np.zeros(3, np.float32)
    episode = play(env, lambda obs: zero, seed=0, options={"start": "upright"})
    assert episode.is_success
    assert 0.5 <= episode.t[-1] <= 1.0
    assert episode.reward_terms["success"][-1] == reward.SUCCESS
    for start in ("roof", "side"):
        episode = play(env, lambda obs: zero, seed=0, options={"start": start})
        assert not episode.is_success
        assert episode.t[-1] == pytest.approx(10.0)
        assert episode.reward.sum() < -4
    env.reset(seed=0, options={"start": "upright"})
    for _ in range(13):
        *_, terminated, _, info = env.step(zero)
    while not terminated:
        *_, terminated, _, info = env.step(zero)
    assert info["is_success"] is True
    assert 0.5 <= info["time_to_upright"] <= 1.0
    assert set(info) >= {"is_success", "energy", "work", "tilt", "n_contacts", "reward_terms"}
    assert tuple(info["reward_terms"]) == reward.TERMS


def test_work_and_energy_balance():
    """Energy never grows by more than the actuator's work."""
    env = FlipCarEnv()
    rng = np.random.default_rng(0)
    for seed, start in enumerate(("roof", "side", "crash", "drop")):
        episode = play(env, lambda obs: rng.uniform(-1, 1, 3), seed=seed, options={"start": start})
        gained = np.diff(episode.energy)
        worked = np.diff(episode.work)
        assert (gained <= worked + 0.5).all()  # J, of tens of kJ


def test_the_car_leaves_the_field_and_is_cut():
    env = FlipCarEnv()
    env.reset(seed=0, options={"start": "upright"})
    state = env.get_state()
    state[0], state[2], state[7] = 99.9, 3.0, 20.0
    env.set_state(state)
    *_, terminated, truncated, _ = env.step(np.zeros(3, np.float32))
    assert truncated
    assert not terminated
