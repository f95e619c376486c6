"""Train a policy with Stable-Baselines3's PPO."""

import json
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np


@dataclass
class Config:
    """What `flipcar train` can be told. Values that depart from SB3's defaults say why."""

    steps: int = 4_000_000
    """Environment steps."""
    num_envs: int = 64
    """Cars that learn together. Many, because stepping them is almost free."""
    seed: int = 0
    """Of the network, the minibatches and the starts (environment i starts from seed + i)."""
    start: str = "any"
    """Kind of start."""
    out: Path | None = None
    """Run directory; runs/ppo-seed-time unless given."""
    n_steps: int = 128
    """Steps of each car between updates: 8192 transitions an update with 64 cars."""
    batch_size: int = 2048
    """Big minibatches: small ones spend their time in Python."""
    n_epochs: int = 8
    """Passes over each batch of transitions."""
    learning_rate: float = 5e-4
    """At the start; it falls linearly to a tenth. Higher than SB3's 3e-4, as batches are big."""
    gamma: float = 0.995
    """A recovery takes up to 250 steps, and the first swings must see the end."""
    gae_lambda: float = 0.95
    """SB3's default."""
    ent_coef: float = 0.001
    """A little, so that it goes on trying directions."""
    hidden: tuple[int, ...] = (64, 64)
    """Layers of the policy and of the value function."""
    eval_episodes: int = 2000
    """Episodes of the final evaluation, on seeds that training never used."""


def train(config: Config) -> Path:
    """Train, export and evaluate; returns the run directory.

    It holds config.json (with versions), progress.csv, model.zip (SB3's), policy.npz (ours) and
    evaluation.json.
    """
    from stable_baselines3.common import logger

    from flipcar_env.policy import load_policy, save_policy

    from .evaluate import evaluate
    from .progress import ProgressBar

    name = f"ppo-{config.seed}-{time.strftime('%Y%m%d-%H%M%S')}"
    out = config.out or Path("runs") / name
    out.mkdir(parents=True, exist_ok=True)
    versions = {
        package: version(package)
        for package in ("flipcar", "stable-baselines3", "torch", "numba", "numpy", "gymnasium")
    }
    settings = {**asdict(config), "out": str(out), "versions": versions}
    (out / "config.json").write_text(json.dumps(settings, indent=2) + "\n")

    model = learner(config)
    env = model.get_vec_normalize_env()
    model.set_logger(logger.configure(str(out), ["csv"]))
    model.learn(config.steps, callback=ProgressBar(config.steps))
    model.save(out / "model.zip")
    save_policy(out / "policy.npz", layers(model, env), "egocentric")

    policy = load_policy(out / "policy.npz")
    results = evaluate(policy, start=config.start, episodes=config.eval_episodes)
    (out / "evaluation.json").write_text(json.dumps(results, indent=2) + "\n")
    return out


def learner(config: Config):
    """SB3's PPO on its cars, their observations and rewards scaled."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from flipcar_env.sb3 import FlipCarVecEnv

    torch.set_num_threads(1)  # small networks: threads only get in each other's way
    cars = FlipCarVecEnv(config.num_envs, start=config.start)
    env = VecNormalize(cars, gamma=config.gamma, clip_obs=1e6)  # unclipped, so that it folds
    return PPO(
        "MlpPolicy",
        env,
        learning_rate=lambda left: config.learning_rate * (0.1 + 0.9 * left),
        n_steps=config.n_steps,
        batch_size=config.batch_size,
        n_epochs=config.n_epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        ent_coef=config.ent_coef,
        policy_kwargs={"net_arch": list(config.hidden)},
        seed=config.seed,
        device="cpu",
    )


def layers(model, env) -> list[tuple[np.ndarray, np.ndarray]]:
    """The policy's layers, with the observation scaling of `env` (a VecNormalize) folded in."""
    network = model.policy
    linear = [m for m in network.mlp_extractor.policy_net if hasattr(m, "weight")]
    weights = [
        (m.weight.detach().numpy().astype(np.float64), m.bias.detach().numpy().astype(np.float64))
        for m in (*linear, network.action_net)
    ]
    sigma = np.sqrt(env.obs_rms.var + env.epsilon)
    weight, bias = weights[0]
    weights[0] = (weight / sigma, bias - weight @ (env.obs_rms.mean / sigma))
    return weights
