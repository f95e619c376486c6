"""A policy file: the same actions as SB3's, the same bits in any batch, and refusals by name."""

from itertools import pairwise

import numpy as np
import pytest

from flipcar_env import load_policy, terrain
from flipcar_env.policy import Policy, save_policy, shipped


def test_the_exported_policy_is_sb3s(tmp_path):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from flipcar_env.sb3 import FlipCarVecEnv
    from train.learner import exported

    torch.manual_seed(0)
    env = VecNormalize(FlipCarVecEnv(4), clip_obs=1e6)
    env.seed(0)
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=2, device="cpu")
    model.learn(512)
    save_policy(tmp_path / "p.npz", *exported(model))
    policy = load_policy(tmp_path / "p.npz")
    rng = np.random.default_rng(0)
    obs = rng.normal(size=(500, 10)).astype(np.float32) * [1, 1, 1, 5, 5, 5, 3, 3, 3, 1]
    obs = obs.astype(np.float32)
    expected, _ = model.predict(env.normalize_obs(obs), deterministic=True)
    np.testing.assert_allclose(policy(obs), expected, atol=2e-5)
    assert np.abs(expected).max() > 0.01


def test_a_row_has_the_same_bits_alone_and_in_any_batch():
    policy = load_policy("nominal")
    obs = np.random.default_rng(0).normal(size=(100, 10)).astype(np.float32)
    together = policy(obs)
    assert together.dtype == np.float32
    assert together.shape == (100, 3)
    assert np.abs(together).max() <= 1
    for i in range(100):
        np.testing.assert_array_equal(policy(obs[i]), together[i])
    np.testing.assert_array_equal(policy(obs[37:61]), together[37:61])
    np.testing.assert_array_equal(policy(obs[::3]), together[::3])


def test_the_forward_pass_is_the_obvious_one():
    rng = np.random.default_rng(1)
    sizes = [13, 7, 5, 3]
    weights = [(rng.normal(size=(m, n)) / 4, rng.normal(size=m) / 4) for n, m in pairwise(sizes)]
    obs = rng.normal(size=(20, 13)).astype(np.float32)
    hidden = obs.astype(float)
    for i, (weight, bias) in enumerate(weights):
        hidden = hidden @ weight.T + bias
        hidden = np.tanh(hidden) if i < 2 else hidden.clip(-1, 1)
    np.testing.assert_allclose(Policy(weights, "state")(obs), hidden, atol=1e-6)


def test_bad_policies_are_named(tmp_path):
    assert "nominal" in shipped()
    with pytest.raises(ValueError, match=r"'nominal'.*got 'best'"):
        load_policy("best")
    corrupt = tmp_path / "corrupt.npz"
    corrupt.write_bytes(b"PK\x03\x04 not a policy")
    with pytest.raises(ValueError, match="can't be read"):
        load_policy(corrupt)
    whole = tmp_path / "whole.npz"
    save_policy(whole, [(np.zeros((3, 10)), np.zeros(3))], "egocentric")
    cut = tmp_path / "cut.npz"
    cut.write_bytes(whole.read_bytes()[:-200])
    with pytest.raises(ValueError, match="can't be read"):
        load_policy(cut)
    for layers, word in [
        ([(np.zeros((3, 9)), np.zeros(3))], r"\(n, 10\)"),
        ([(np.zeros((2, 10)), np.zeros(2))], "3 outputs"),
        ([(np.full((3, 10), np.nan), np.zeros(3))], "finite"),
    ]:
        save_policy(whole, layers, "egocentric")
        with pytest.raises(ValueError, match=word):
            load_policy(whole)
    with pytest.raises(ValueError, match=r"\(10,\) or \(n, 10\), got \(9,\)"):
        load_policy("nominal")(np.zeros(9, np.float32))


def test_the_shipped_policy_recovers_the_car():
    from train.evaluate import evaluate

    result = evaluate(load_policy("nominal"), start="roof", episodes=200)
    assert result["wilson"][0] > 0.8
    assert result["time_median"] < 6


@pytest.mark.parametrize("ground", terrain.KINDS)
def test_the_robust_policy_recovers_other_cars_on_any_ground(ground):
    from train.evaluate import evaluate

    policy = load_policy("robust")
    assert policy.obs == "egocentric+action"
    result = evaluate(policy, "side", 60, terrain=ground, randomize=True, obs=policy.obs)
    assert result["success"] > 0.9
