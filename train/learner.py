"""Train a policy with Stable-Baselines3."""

import json
import time
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from . import config as settings
from .config import Config


def train(config: Config) -> Path:
    """Train, export and evaluate; returns the run directory.

    It holds config.json (with versions), progress.csv and TensorBoard's events, checkpoint.pkl,
    model.zip (SB3's), policy.npz (ours) and evaluation.json.
    """
    name = f"{config.task}-{config.algorithm}-{config.seed}-{time.strftime('%Y%m%d-%H%M%S')}"
    out = config.out or Path("runs") / name
    if (out / "config.json").exists():
        raise ValueError(f"out must not hold a run already, got {str(out)!r}; resume it or choose another")
    out.mkdir(parents=True, exist_ok=True)
    versions = {
        package: version(package)
        for package in ("flipcar", "stable-baselines3", "torch", "numba", "numpy", "gymnasium")
    }
    known = {
        **asdict(config),
        "out": str(out),
        "steps": steps(config),
        "num_envs": settings.num_envs(config),
        "versions": versions,
    }
    (out / "config.json").write_text(json.dumps(known, indent=2) + "\n")
    return _run(config, out, learner(config), [])


def resume(out: Path) -> Path:
    """Go on with a run that was cut off, to the same bits as if it had not been; see `train`.

    Raises:
        ValueError: there is no such run.
    """
    from . import checkpoint

    if not (out / "config.json").is_file():
        raise ValueError(f"resume must be a run directory, got {str(out)!r}")
    known = json.loads((out / "config.json").read_text())
    config = Config(**{field.name: known[field.name] for field in fields(Config)})
    config.out = out
    kept = out / checkpoint.FILE
    model, logged = checkpoint.load(kept) if kept.exists() else (learner(config), [])
    return _run(config, out, model, logged)


def _run(config: Config, out: Path, model: Any, logged: list[tuple]) -> Path:
    from flipcar_env.policy import load_policy, save_policy
    from flipcar_env.sb3 import RecordEpisodes

    from . import checkpoint, progress
    from .evaluate import evaluate

    total = steps(config)
    model.set_logger(progress.logger(out, model.num_timesteps))
    for entry in logged:
        model.logger.record(*entry)
    callbacks = [progress.ProgressBar(total), checkpoint.Checkpoints(out)]
    if config.algorithm == "ppo" and config.task in settings.LEAST_NOISE:
        callbacks.append(progress.LessNoise(settings.LEAST_NOISE[config.task]))
    if config.record_every:
        callbacks.append(RecordEpisodes(out / "recordings", config.record_every))
    model.learn(total - model.num_timesteps, callback=callbacks, reset_num_timesteps=False)
    model.logger.close()
    model.save(out / "model.zip")
    save_policy(out / "policy.npz", *exported(model))

    policy = load_policy(out / "policy.npz")
    randomize = config.task == "robust"
    results = evaluate(policy, "any", config.eval_episodes, randomize=randomize, obs=policy.obs)
    (out / "evaluation.json").write_text(json.dumps(results, indent=2) + "\n")
    return out


def steps(config: Config) -> int:
    """How many environment steps a run takes."""
    return config.steps or settings.STEPS[config.algorithm, config.task]


def learner(config: Config) -> Any:
    """SB3's algorithm on its cars, their observations and rewards scaled."""
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.vec_env import VecNormalize

    from flipcar_env.sb3 import FlipCarVecEnv

    torch.set_num_threads(1)  # small networks: threads only get in each other's way
    cars = FlipCarVecEnv(settings.num_envs(config), **settings.cars(config))
    env = VecNormalize(cars, gamma=settings.GAMMA, clip_obs=1e6)  # unclipped, so that it folds
    chosen = dict(settings.SAC)
    if config.algorithm == "ppo":
        chosen = {"n_steps": max(1, settings.UPDATE // settings.num_envs(config)), **settings.PPO}
    rate, network = chosen.pop("learning_rate"), {"net_arch": chosen.pop("net_arch")}
    if config.algorithm == "sac":
        network["activation_fn"] = torch.nn.Tanh  # as in a policy file
    return {"ppo": PPO, "sac": SAC}[config.algorithm](
        "MlpPolicy",
        env,
        learning_rate=lambda left: rate * (settings.LAST + (1.0 - settings.LAST) * left),
        policy_kwargs=network,
        seed=config.seed,
        device="cpu",
        **chosen,
    )


def exported(model: Any) -> tuple[list[tuple[np.ndarray, np.ndarray]], str, bool]:
    """What `save_policy` takes of a model: layers with the scaling folded in, kind of observation, squash."""
    env, network = model.get_vec_normalize_env(), model.policy
    squash = hasattr(network, "actor")
    if squash:
        modules = [*network.actor.latent_pi, network.actor.mu]
    else:
        modules = [*network.mlp_extractor.policy_net, network.action_net]
    weights = [
        (m.weight.detach().numpy().astype(np.float64), m.bias.detach().numpy().astype(np.float64))
        for m in modules
        if hasattr(m, "weight")
    ]
    sigma = np.sqrt(env.obs_rms.var + env.epsilon)
    weight, bias = weights[0]
    weights[0] = (weight / sigma, bias - weight @ (env.obs_rms.mean / sigma))
    return weights, env.venv.core.obs_kind, squash
