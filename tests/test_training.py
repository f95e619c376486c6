"""Training: what it writes, and that a run that was cut off goes on to the same bits."""

import csv
import json

import numpy as np
import pytest

from flipcar_env import load_policy
from train import checkpoint, config, learner
from train.config import Config

SMALL = {
    "ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net_arch": [16]},
    "sac": {"buffer_size": 1000, "learning_starts": 100, "batch_size": 32, "net_arch": [16]},
}


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(config, "PPO", config.PPO | SMALL["ppo"])
    monkeypatch.setattr(config, "SAC", config.SAC | SMALL["sac"])
    monkeypatch.setattr(checkpoint, "EVERY", 256)
    monkeypatch.setattr(checkpoint.Checkpoints.__init__, "__defaults__", (256,))


class CutOff(Exception):
    pass


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_run_that_was_cut_off_goes_on_to_the_same_bits(algorithm, tmp_path, monkeypatch):
    def run(name):
        return Config(
            "robust",
            algorithm,
            1024,
            num_envs=8,
            seed=3,
            out=tmp_path / name,
            record_every=10,
            eval_episodes=20,
        )

    whole = learner.train(run("whole"))
    save, saved = checkpoint.save, []

    def save_and_die(path, model):
        if len(saved) == 2:
            raise CutOff
        save(path, model)
        saved.append(model.num_timesteps)

    monkeypatch.setattr(checkpoint, "save", save_and_die)
    with pytest.raises(CutOff):
        learner.train(run("cut"))
    monkeypatch.setattr(checkpoint, "save", save)
    assert 256 < saved[-1] < 1024
    cut = learner.resume(tmp_path / "cut")

    with np.load(whole / "policy.npz") as a, np.load(cut / "policy.npz") as b:
        assert sorted(a) == sorted(b)
        for name in a:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)
    curves = []
    for out in (whole, cut):
        rows = list(csv.DictReader((out / "progress.csv").open()))
        clock = {"time/fps", "time/time_elapsed", "time/iterations"}
        curves.append([{k: v for k, v in row.items() if k not in clock} for row in rows])
        assert json.loads((out / "evaluation.json").read_text())["episodes"] == 20
        assert list(out.glob("events.out.tfevents.*"))
        assert list((out / "recordings").glob("*.rrd"))
        known = json.loads((out / "config.json").read_text())
        assert known["steps"] == 1024
        assert known["versions"]["torch"]
    assert curves[0] == curves[1]
    assert load_policy(cut / "policy.npz")(np.zeros((2, 13), np.float32)).shape == (2, 3)


def test_a_squashed_policy_is_sacs(tmp_path):
    from flipcar_env.policy import save_policy

    model = learner.learner(Config(algorithm="sac", num_envs=4))
    model.learn(256)
    save_policy(tmp_path / "p.npz", *learner.exported(model))
    obs = np.random.default_rng(0).normal(size=(100, 10)).astype(np.float32)
    scaled = model.get_vec_normalize_env().normalize_obs(obs)
    expected, _ = model.predict(scaled, deterministic=True)
    np.testing.assert_allclose(load_policy(tmp_path / "p.npz")(obs), expected, atol=2e-5)
    assert np.abs(expected).max() > 0.01


def test_runs_that_cannot_be_are_named(tmp_path):
    with pytest.raises(ValueError, match="resume must be a run directory"):
        learner.resume(tmp_path)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ValueError, match="out must not hold a run"):
        learner.train(Config(out=tmp_path))
