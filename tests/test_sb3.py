"""Stable-Baselines3's environment: its contract, and that it is the single one."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from flipcar_env import FlipCarEnv, check_vec_env
from flipcar_env import row as r
from flipcar_env.sb3 import FlipCarVecEnv


def test_it_is_the_single_environment():
    check_vec_env(
        lambda: gym.make("FlipCar-v0"), None, lambda n: FlipCarVecEnv(n, stagger=False), num_envs=9, steps=260
    )


def test_infos_of_finished_environments_have_what_sb3_reads():
    env = FlipCarVecEnv(6, stagger=False, start="upright")
    env.seed(4)
    obs = env.reset()
    total, seen = np.zeros(6), 0
    for step in range(1, 60):
        obs, rewards, dones, infos = env.step(np.zeros((6, 3)))
        total += rewards
        for i, info in enumerate(infos):
            if not dones[i]:
                assert info == {}
                continue
            if info["episode"]["l"] == step:
                assert info["episode"]["r"] == pytest.approx(total[i], abs=1e-5)
            assert info["is_success"] is True
            assert info["TimeLimit.truncated"] is False
            assert not np.array_equal(info["terminal_observation"], obs[i])
            assert info["episode"]["t"] > 0
            seen += 1
    assert seen >= 6
    assert rewards.dtype == np.float32


def test_timeouts_do_not_come_together():
    """Left to themselves, cars on their roofs all run out of time at once, and again and again."""
    n = 50
    ends = {}
    for stagger in (True, False):
        env = FlipCarVecEnv(n, stagger=stagger, start="roof")
        env.seed(0)
        env.reset()
        ends[stagger] = np.array([env.step(np.zeros((n, 3)))[2].sum() for _ in range(520)])
    assert ends[True].max() == 1
    assert ends[True].sum() == pytest.approx(n * 520 / 250, rel=0.6)
    assert ends[False].max() == n


def test_a_curriculum_by_attribute_and_options():
    env = FlipCarVecEnv(4, start="roof")
    assert env.get_attr("start") == ["roof"] * 4
    env.set_attr("start", "drop", indices=[1, 2])
    assert env.get_attr("start") == ["roof", "drop", "drop", "roof"]
    assert env.get_attr("render_mode", indices=0) == [None]
    env.seed(0)
    env.reset()
    assert list(env.core.rows[:, r.START]) == [0, 3, 3, 0]
    env.set_options({"start": "upright"})
    env.reset()
    assert list(env.core.rows[:, r.START]) == [5] * 4
    env.reset()
    assert list(env.core.rows[:, r.START]) == [0, 3, 3, 0]
    state = env.env_method("get_state")[2]
    env.set_options([{}, {"state": state}, {}, {"start": "side"}])
    env.reset()
    np.testing.assert_array_equal(env.env_method("get_state")[1], state)
    assert [info["start"] for info in env.reset_infos] == ["roof", "drop", "drop", "side"]
    for call, word in (
        (lambda: env.set_options({"state": state, "start": "roof"}), "both"),
        (lambda: env.set_options({"state": state[:3]}), "state"),
        (lambda: env.set_attr("start", "moon"), "moon"),
        (lambda: env.set_attr("colour", "red"), "colour"),
        (lambda: env.env_method("fly"), "fly"),
        (lambda: FlipCarVecEnv(2, stagger=1), "stagger"),
        (lambda: FlipCarVecEnv(0), "num_envs"),
        (lambda: env.seed(-3), "seed"),
        (lambda: env.step(np.full((4, 3), np.nan)), "finite"),
        (lambda: env.step(np.zeros((3, 3))), "shape"),
    ):
        with pytest.raises(ValueError, match=word):
            call()


def test_a_refused_call_changes_no_environment():
    env = FlipCarVecEnv(4, start="roof")
    with pytest.raises(ValueError, match="reset"):
        env.step(np.zeros((4, 3)))
    env.seed(0)
    env.reset()
    before, state = env.core.rows.copy(), env.env_method("get_state")[0]
    state[0] = 3.0
    for call, word in (
        (lambda: env.env_method("set_state", state, indices=[0, 4]), "indices.*0 to 3"),
        (lambda: env.env_method("set_state", state, indices=[True, False]), "indices.*0 to 3"),
        (lambda: env.env_method("set_state", state[:3]), "shape"),
        (lambda: env.set_attr("start", "drop", indices=[0, -1]), "indices.*0 to 3"),
        (lambda: env.set_options({"colour": "red"}), "colour"),
        (lambda: env.set_options({"start": "moon"}), "moon"),
        (lambda: env.set_options([{"start": "drop"}] * 3), "each of 4"),
        (lambda: env.step(np.full((4, 3), "left")), "actions"),
    ):
        with pytest.raises(ValueError, match=word):
            call()
        np.testing.assert_array_equal(env.core.rows, before)
    assert env.get_attr("start", indices=np.int64(2)) == ["roof"]
    env.set_options([{"start": "drop"}, {}, {"start": "side"}, {}])
    env.reset()
    assert list(env.core.rows[:, r.START]) == [3, 0, 1, 0]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_lives_on_alike(again):
    env = FlipCarVecEnv(5)
    env.seed(1)
    env.reset()
    other = again(env)
    for _ in range(60):
        for a, b in zip(env.step(np.ones((5, 3)))[:3], other.step(np.ones((5, 3)))[:3], strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_state_that_is_set_is_not_cut_short_by_the_first_episodes_limit():
    env = FlipCarVecEnv(10, start="roof")
    env.seed(0)
    env.reset()
    state = env.env_method("get_state", indices=0)[0]
    state[r.STEPS] = 200
    env.env_method("set_state", state, indices=0)
    dones = [env.step(np.zeros((10, 3)))[2][0] for _ in range(50)]
    assert np.flatnonzero(dones).tolist() == [49]


def test_an_episode_is_as_long_as_it_has_been_played():
    """Also from a state in the middle of one, and where the solver gives up."""
    env = FlipCarVecEnv(9, start="roof", stagger=False)
    env.reset()
    state = env.env_method("get_state", indices=0)[0]
    state[r.STEPS] = 240
    env.env_method("set_state", state, indices=0)
    for _ in range(3):
        env.step(np.ones((9, 3)))
    state[r.MOTION + 7] = state[r.MOTION + 10] = 1e300
    env.core.states[1] = state
    infos = [env.step(np.zeros((9, 3)))[3] for _ in range(7)]
    assert infos[0][1]["solver_error"]
    assert infos[0][1]["episode"]["l"] == 4
    assert infos[6][0]["episode"]["l"] == 10


def test_methods_of_each_environment():
    env = FlipCarVecEnv(3)
    env.seed(7)
    env.reset()
    states = env.env_method("get_state")
    single = FlipCarEnv()
    single.reset(seed=8)
    np.testing.assert_array_equal(states[1], single.get_state())
    env.step(np.ones((3, 3)))
    env.env_method("set_state", states[1], indices=[1])
    np.testing.assert_array_equal(env.env_method("get_state", indices=1)[0], states[1])
    assert env.env_is_wrapped(VecMonitor) == [False] * 3
    assert env.get_images() == [None] * 3


def test_ppo_learns_on_it_wrapped_as_users_wrap_it():
    env = VecNormalize(VecMonitor(FlipCarVecEnv(8)))
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=128, n_epochs=1, seed=0, device="cpu")
    model.learn(2048)
    assert model.num_timesteps == 2048
    assert len(model.ep_info_buffer) > 0


def test_a_recorded_training_is_the_same_and_what_is_recorded_has_happened(tmp_path, monkeypatch):
    from flipcar_env import recording
    from flipcar_env.sb3 import RecordEpisodes

    kept, ended = [], []
    save = recording.save
    monkeypatch.setattr(
        recording, "save", lambda path, episodes: (kept.extend(episodes), save(path, episodes))
    )

    class Watch(BaseCallback):
        def _on_step(self):
            if self.locals["dones"][0]:
                ended.append(self.locals["infos"][0]["episode"])
            return True

    trained = []
    for callbacks in ([], [Watch(), RecordEpisodes(tmp_path / "some", every=8)]):
        env = FlipCarVecEnv(6, terrain=["slope", "level"] * 3, randomize=True, action_delay=1)
        model = PPO("MlpPolicy", env, n_steps=200, batch_size=300, n_epochs=1, seed=1, device="cpu")
        model.learn(6 * 800, callback=callbacks)
        trained.append([p.detach().numpy() for p in model.policy.parameters()])
    for a, b in zip(*trained, strict=True):
        np.testing.assert_array_equal(a, b)
    files = sorted((tmp_path / "some").iterdir())
    assert len(files) == len(kept) >= 2
    sums = [e["r"] for e in ended]
    for episode in kept:
        assert episode.terrain == "slope"
        assert min(abs(episode.reward.sum() - r) for r in sums) < 1e-9
    with pytest.raises(ValueError, match="FlipCarVecEnv"):
        PPO("MlpPolicy", "CartPole-v1", device="cpu").learn(1, callback=RecordEpisodes(tmp_path))
    with pytest.raises(ValueError, match="every"):
        RecordEpisodes(tmp_path, every=0)
