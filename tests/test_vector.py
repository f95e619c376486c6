"""Batches of environments: Gymnasium's contract, equality with the single one, bad input, failures."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import flipcar_env
from flipcar_env import FlipCarEnv, check_vec_env, starts
from flipcar_env import row as r
from flipcar_env.core import Core
from flipcar_env.vector import FlipCarVectorEnv


def make(n, **arguments):
    return gym.make_vec("FlipCar-v0", num_envs=n, vectorization_mode="vector_entry_point", **arguments)


def same(a, b, where):
    """Equal in value, type and structure."""
    if isinstance(b, tuple):
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where} {i}")
    elif isinstance(b, dict):
        assert set(a) == set(b), where
        for key in b:
            same(a[key], b[key], f"{where} {key}")
    elif isinstance(b, np.ndarray) and b.dtype == object:
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}[{i}]")
    elif isinstance(b, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
    else:
        assert a == b, where


@pytest.mark.parametrize("mode", AutoresetMode)
def test_it_is_gymnasiums_own_vector_environment_of_single_ones(mode):
    n, steps = 6, 300
    ours, theirs = make(n, autoreset_mode=mode), SyncVectorEnv([FlipCarEnv] * n, autoreset_mode=mode)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == mode
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, n, 3)).astype(np.float32)
    same(ours.reset(seed=3), theirs.reset(seed=3), "reset")
    ends = 0
    for t in range(steps):
        got, want = ours.step(actions[t]), theirs.step(actions[t])
        for name, a, b in zip(("obs", "reward", "terminated", "truncated", "infos"), got, want, strict=True):
            same(a, b, f"step {t} {name}")
        over = want[2] | want[3]
        ends += over.sum()
        if mode == AutoresetMode.DISABLED and over.any():
            before = ours.get_state()
            got = ours.reset(options={"reset_mask": over})
            same(got, theirs.reset(options={"reset_mask": over}), f"step {t} reset")
            np.testing.assert_array_equal(ours.get_state()[~over], before[~over])
    assert ends > 5


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("threads", [1, 3])
def test_check_vec_env_finds_nothing(mode, threads):
    check_vec_env(
        lambda: gym.make("FlipCar-v0", randomize=True),
        lambda n: make(n, autoreset_mode=mode, threads=threads, randomize=True),
        num_envs=21,
        seed=11,
        steps=260,
    )


def test_every_lane_has_the_bits_of_one_alone_from_every_start():
    """The physics for eight bodies at once, in groups that are sorted anew each step, in threads."""
    kinds = [*starts.KINDS, "any"] * 9
    n = len(kinds)
    random = [i % 2 == 0 for i in range(n)]
    planes = [("level", "level", "slope")[i % 3] for i in range(n)]
    alone = [Core(1, kinds[i], planes[i], random[i]) for i in range(n)]
    batch = Core(n, kinds, planes, random)
    shuffled = Core(n, kinds[::-1], planes[::-1], random[::-1], threads=2)
    for i, core in enumerate(alone):
        for c, j in ((core, 0), (batch, i), (shuffled, n - 1 - i)):
            c.seed(j, 100 + i)
        core.begin(np.zeros(1, np.int64))
    batch.begin(np.arange(n))
    shuffled.begin(np.arange(n))
    rng = np.random.default_rng(0)
    most = 0
    for t in range(150):
        actions = rng.uniform(-1, 1, (n, 3)).astype(np.float32)
        if t % 50 < 20:
            actions[:] = 0.0
        batch.step(actions)
        shuffled.step(actions[::-1].copy())
        for i, core in enumerate(alone):
            core.step(actions[i : i + 1])
        expected = np.concatenate([core.rows for core in alone])
        np.testing.assert_array_equal(batch.rows, expected)
        np.testing.assert_array_equal(shuffled.rows[::-1], expected)
        most = max(most, max(int(bits).bit_count() for bits in batch.rows[:, r.CLOSED]))
    assert 4 <= most <= r.SLOTS, "contacts beyond the slots would begin each step without a first guess"


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("n", [0, 3, 9])
def test_a_copy_lives_on_by_itself_and_alike(n, again):
    env = make(n) if n else FlipCarEnv()
    actions = np.full((n, 3) if n else 3, 0.7, np.float32)
    env.reset(seed=2)
    env.step(actions)
    other, before = again(env), env.get_state()
    for _ in range(5):
        obs = other.step(actions)[0]
    np.testing.assert_array_equal(env.get_state(), before)
    for _ in range(5):
        want = env.step(actions)[0]
    np.testing.assert_array_equal(obs, want)
    assert not np.array_equal(env.get_state(), before)


def test_the_action_that_next_step_ignores_may_be_anything():
    ours, theirs = make(2, start=["upright", "roof"]), make(2, start=["upright", "roof"])
    for env in (ours, theirs):
        env.reset(seed=0)
    over = np.zeros(2, bool)
    while not over.any():
        for env in (ours, theirs):
            _, _, terminated, truncated, _ = env.step(np.zeros((2, 3)))
        over = terminated | truncated
    assert list(over) == [True, False]
    anything = np.zeros((2, 3))
    anything[0] = np.nan
    same(ours.step(anything), theirs.step(np.zeros((2, 3))), "the next step")
    with pytest.raises(ValueError, match="environment 0"):
        ours.step(anything)


def test_state_get_and_set_for_all_and_for_some():
    env = make(5, start=["roof", "side", "nose", "drop", "crash"])
    _, infos = env.reset(seed=1)
    assert list(infos["start"]) == ["roof", "side", "nose", "drop", "crash"]
    actions = np.full((5, 3), 0.3, np.float32)
    state = env.get_state()
    first = env.step(actions)
    env.step(actions)
    env.set_state(state)
    same(env.step(actions), first, "again")
    env.set_state(state[[1, 3]], indices=[1, 3])
    np.testing.assert_array_equal(env.get_state()[[1, 3]], state[[1, 3]])
    obs, _ = env.reset(options={"state": state})
    np.testing.assert_array_equal(env.get_state(), state)
    obs, infos = env.reset(options={"start": "upright"})
    assert list(infos["start"]) == ["upright"] * 5
    np.testing.assert_allclose(infos["tilt"], 0.0, atol=1e-6)


def test_episode_statistics_and_default_of_gymnasiums_wrapper():
    assert make(2).metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    env = RecordEpisodeStatistics(make(4, start="upright"))
    env.reset(seed=0)
    for _ in range(40):
        *_, infos = env.step(np.zeros((4, 3), np.float32))
        if "episode" in infos:
            break
    alone = FlipCarEnv(start="upright")
    i = int(np.flatnonzero(infos["_episode"])[0])
    alone.reset(seed=i)
    total, over, length = 0.0, False, 0
    while not over:
        _, reward, over, _, info = alone.step(np.zeros(3, np.float32))
        total, length = total + reward, length + 1
    assert infos["episode"]["r"][i] == pytest.approx(total, abs=1e-6)
    assert infos["episode"]["l"][i] == length
    assert infos["time_to_upright"][i] == info["time_to_upright"]


def test_observations_handed_out_never_change():
    env = make(8)
    seen = [env.reset(seed=0)[0]]
    copies = [seen[0].copy()]
    for _ in range(5):
        seen.append(env.step(np.ones((8, 3), np.float32))[0])
        copies.append(seen[-1].copy())
    for a, b in zip(seen, copies, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"num_envs": 0}, ["num_envs", ">= 1", "0"]),
        ({"num_envs": 2.5}, ["num_envs", "2.5"]),
        ({"threads": 0}, ["threads", ">= 1", "0"]),
        ({"threads": True}, ["threads", "True"]),
        ({"start": ["roof"]}, ["start", "3"]),
        ({"start": ["roof", "side", "moon"]}, ["start", "'roof'", "moon"]),
        ({"randomize": "yes"}, ["randomize", "yes"]),
        ({"randomize": [True, False]}, ["randomize", "3"]),
        ({"autoreset_mode": "never"}, ["autoreset_mode", "NextStep", "never"]),
        ({"render_mode": "human"}, ["render_mode", "human"]),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(ValueError) as caught:
        FlipCarVectorEnv(**{"num_envs": 3, **arguments})
    for word in words:
        assert word in str(caught.value)


NAN = np.array([[0, 0, 0], [0, 0, 0], [0, np.nan, 0]])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda env: env.step(NAN), ["actions", "finite", "environment 2"]),
        (lambda env: env.step(np.zeros((2, 3))), ["actions", "(3, 3)", "(2, 3)"]),
        (lambda env: env.step(np.full((3, 3), "left")), ["actions", "real numbers"]),
        (lambda env: env.step(np.zeros((3, 3), complex)), ["actions", "complex"]),
        (lambda env: env.reset(seed=-1), ["seed", ">= 0", "-1"]),
        (lambda env: env.reset(seed=[1, 2]), ["seed", "3", "[1, 2]"]),
        (lambda env: env.reset(seed=[1, 2, 0.5]), ["seed", "0.5"]),
        (lambda env: env.reset(options={"reset_mask": np.array([True])}), ["reset_mask", "(3,)"]),
        (lambda env: env.reset(options={"reset_mask": np.array([1, 0, 1])}), ["reset_mask", "bool"]),
        (lambda env: env.reset(options={"reset_mask": np.zeros(3, bool)}), ["reset_mask", "True"]),
        (lambda env: env.reset(options={"start": "moon"}), ["start", "moon"]),
        (lambda env: env.reset(options={"start": ["roof"]}), ["start", "3"]),
        (lambda env: env.reset(options={"colour": 1}), ["options", "colour"]),
        (lambda env: env.reset(options={"state": np.zeros((2, r.STATE))}), ["state", "shape"]),
        (lambda env: env.set_state(env.get_state() * np.nan), ["state", "finite"]),
        (lambda env: env.set_state(env.get_state()[:1], indices=[7]), ["indices", "7"]),
        (lambda env: env.set_state(env.get_state()[:1], indices=[0.5]), ["indices", "0.5"]),
        (lambda env: env.set_state(env.get_state(), indices=np.ones(3, bool)), ["indices", "True"]),
        (lambda env: env.step([[0.0] * 3, [0.0] * 3, [0.0]]), ["actions", "real numbers"]),
    ],
)
def test_a_refused_call_changes_no_environment(call, words):
    env = FlipCarVectorEnv(3)
    env.reset(seed=0)
    before = env.core.rows.copy()
    with pytest.raises(ValueError) as caught:
        call(env)
    for word in words:
        assert word in str(caught.value)
    np.testing.assert_array_equal(env.core.rows, before)


@pytest.mark.parametrize(
    ("entry", "value", "word"),
    [
        (r.MOTION, -1e301, "motion"),
        (r.MASS, 0.0, "mass"),
        (r.INERTIA, -1.0, "inertia"),
        (r.INERTIA, 9e9, "inertia"),
        (r.FRICTION, -0.1, "friction"),
        (r.RESTITUTION, 1.5, "restitution"),
        (r.CLOSED, 0.5, "contacts"),
        (r.CLOSED, 2.0**30, "contacts"),
        (r.START, 99.0, "start"),
    ],
)
def test_a_state_that_is_none_is_named(entry, value, word):
    env = FlipCarVectorEnv(3)
    env.reset(seed=0)
    state = env.get_state()
    state[1, entry] = value
    with pytest.raises(ValueError, match=word):
        env.set_state(state)


def test_before_the_first_reset_and_after_the_end_of_an_episode():
    env = make(2, autoreset_mode=AutoresetMode.DISABLED, start=["upright", "roof"])
    with pytest.raises(ValueError, match="reset"):
        env.step(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.array([True, False])})
    env.reset(seed=0)
    over = np.zeros(2, bool)
    while not over.any():
        _, _, terminated, truncated, _ = env.step(np.zeros((2, 3)))
        over = terminated | truncated
    before = env.get_state()
    with pytest.raises(ValueError, match=r"\[0\]"):
        env.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(env.get_state(), before)


def runaway(state):
    """A state that no solver can follow: it soon overflows."""
    state[..., r.MOTION + 7] = 1e300
    state[..., r.MOTION + 10] = 1e300
    return state


@pytest.mark.parametrize("n", [3, 11])
def test_one_that_is_no_longer_finite_ends_alone_and_can_be_replayed(n):
    env, healthy = make(n), make(n)
    env.reset(seed=0)
    healthy.reset(seed=0)
    state = env.get_state()
    state[1] = runaway(state[1])
    env.set_state(state)
    actions = np.full((n, 3), 0.5, np.float32)
    obs, reward, terminated, truncated, infos = env.step(actions)
    others = np.arange(n) != 1
    for a, b in zip((obs, reward, terminated, truncated), healthy.step(actions)[:4], strict=True):
        np.testing.assert_array_equal(a[others], b[others])
    assert truncated[1]
    assert not terminated[1]
    assert np.isfinite(obs).all()
    assert np.isfinite(reward).all()
    assert list(np.flatnonzero(infos["_solver_error"])) == [1]
    assert "finite" in infos["solver_error"][1]
    np.testing.assert_array_equal(infos["solver_error_state"][1], state[1])
    alone = FlipCarEnv()
    alone.reset(options={"state": infos["solver_error_state"][1]})
    *_, truncated, info = alone.step(actions[1])
    assert truncated
    np.testing.assert_array_equal(info["solver_error_state"], state[1])
    np.testing.assert_array_equal(alone.contact_impulses(), 0.0)
    obs, _, _, truncated, infos = env.step(actions)  # it begins anew
    assert not truncated[1]
    assert "solver_error" not in infos


class Broken(FlipCarVectorEnv):
    """A vector environment with one fault."""

    def __init__(self, n, fault):
        super().__init__(n)
        self.fault, self.buffer, self.rewards = fault, None, np.zeros(n)
        self.ends = np.zeros(n, bool)

    def reset(self, *, seed=None, options=None):
        late = self.fault == "late" and self.core.rows[0, r.STEPS] > 0
        seed = seed + 1 if self.fault == "seed" or late else seed
        obs, infos = super().reset(seed=seed, options=options)
        if self.fault == "zero":
            obs[obs == 0] *= -1
        self.buffer = obs if self.fault == "buffer" else None
        return obs, infos

    def step(self, actions):
        if self.fault == "nan":
            actions = np.nan_to_num(actions)
        if self.fault == "half" and not np.isfinite(actions).all():
            super().step(np.nan_to_num(actions))
        obs, reward, terminated, truncated, infos = super().step(actions)
        if self.fault == "buffer":
            self.buffer[:] = obs
            obs = self.buffer
        if self.fault == "rewards":
            self.rewards[:] = reward
            reward = self.rewards
        if self.fault == "ends":
            self.ends |= terminated
            terminated = self.ends
        if self.fault == "reward":
            reward[-1] = np.nextafter(reward[-1], 9)
        if self.fault == "final":
            obs = np.where((terminated | truncated)[:, None], 0, obs).astype(np.float32)
        return obs, reward, terminated, truncated, infos


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("seed", "environment 0, step 0: the first observation"),
        ("buffer", "observations handed out before have changed"),
        ("rewards", "rewards handed out before have changed"),
        ("ends", "terminations handed out before have changed"),
        ("late", "after 260 steps the same seed starts other"),
        ("zero", "step 0: the first observation"),
        ("half", "environment 0, step 2 after 2 refused calls"),
        ("reward", "environment 3, step 1: the reward"),
        ("final", "the final observation"),
        ("nan", "which the single one refuses"),
    ],
)
def test_check_vec_env_finds_each_fault(fault, words):
    with pytest.raises(AssertionError, match=words):
        check_vec_env(FlipCarEnv, lambda n: Broken(n, fault), num_envs=4, steps=260)


def test_check_vec_env_serves_other_environments():
    from stable_baselines3.common.vec_env import DummyVecEnv

    def make_one():
        return gym.make("CartPole-v1")

    for mode in AutoresetMode:
        check_vec_env(make_one, lambda n, mode=mode: SyncVectorEnv([make_one] * n, autoreset_mode=mode))
    check_vec_env(make_one, None, lambda n: DummyVecEnv([make_one] * n))
    with pytest.raises(AssertionError, match="first observation"):  # one stream for all of them
        check_vec_env(make_one, lambda n: gym.make_vec("CartPole-v1", n, "vector_entry_point"))
    with pytest.raises(ValueError, match="steps"):
        check_vec_env(FlipCarEnv, make, steps=3)


def test_it_comes_with_the_package():
    assert flipcar_env.check_vec_env is check_vec_env
