"""What `flipcar train` can be told; the hyperparameters, with a reason where they are not SB3's."""

from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from typing import Any, Literal

from flipcar_env import terrain


@dataclass
class Config:
    """A training run."""

    task: Literal["nominal", "robust"] = "nominal"
    """nominal: level ground, the car as built, starts of kind "any". robust: every ground, a car of its own
    for each episode, crashes too; the car knows its last action."""
    algorithm: Literal["ppo", "sac"] = "ppo"
    """PPO, or off-policy SAC."""
    steps: int | None = None
    """Environment steps; unless given what the algorithm needs for the task."""
    num_envs: int | None = None
    """Cars that learn together; unless given what the task needs."""
    seed: int = 0
    """Of the network, the minibatches and the starts (environment i starts from seed + i)."""
    out: Path | None = None
    """Run directory; runs/task-algorithm-seed-time unless given."""
    record_every: int = 0
    """Episodes from one that is recorded for rerun to the next, 100 for each hundredth; 0: none."""
    eval_episodes: int = 2000
    """Episodes of the final evaluation, on seeds that training never used."""


STEPS = {
    ("ppo", "nominal"): 3_000_000,
    ("ppo", "robust"): 8_000_000,
    ("sac", "nominal"): 600_000,
    ("sac", "robust"): 1_500_000,
}

CARS = {"nominal": 64, "robust": 128}
"""Many, because stepping them is almost free; more where there are more kinds of ground and start to meet at
once: of two runs the one with 64 did not learn to turn a car uphill in 16 million steps."""

GAMMA = 0.995
"""A recovery takes up to 250 steps, and the first swings must see the end; SB3 has 0.99."""

UPDATE = 8192
"""Transitions between PPO's updates, of all cars: with 64 cars 128 steps each. SB3 has 2048 of one."""

PPO: dict[str, Any] = {
    "batch_size": 2048,  # small minibatches spend their time in Python
    "n_epochs": 8,
    "learning_rate": 5e-4,  # higher than 3e-4, as batches are big; it falls linearly to a tenth
    "gamma": GAMMA,
    "ent_coef": 0.001,  # a little, so that it goes on trying directions
    "net_arch": [64, 64],
}

SAC: dict[str, Any] = {
    "buffer_size": 600_000,  # all of a nominal run
    "learning_starts": 10_000,  # 156 steps of 64 cars: some episodes are over
    "batch_size": 512,  # 64 new transitions come at once
    "gradient_steps": 4,  # for those 64: one for each, as usual, would take an hour
    "learning_rate": 1e-3,  # few updates, so longer ones
    "gamma": GAMMA,
    "net_arch": [128, 128],  # 256s learn no better here, and take twice as long
}

LEAST_NOISE = {"robust": 0.1}
"""The standard deviation of the policy's actions falls to so much, from 1. Left to itself it stays at 0.3,
with which a stuck car gets free by chance: what is shipped has no noise, and would stay stuck."""

LAST = 0.1
"""Share of the learning rate that is left at the end."""


def num_envs(config: Config) -> int:
    """How many cars learn together."""
    return config.num_envs or CARS[config.task]


def cars(config: Config) -> dict[str, Any]:
    """The arguments of the environments that learn a task."""
    if config.task == "nominal":
        return {"start": "any"}

    def each(values: list[str]) -> list[str]:
        return list(islice(cycle(values), num_envs(config)))

    # Sides and the slope are hardest: most cars learn there.
    grounds = [*terrain.KINDS, "slope", "slope"]
    n = len(grounds)
    return {
        "start": each(["any"] * n + ["side"] * (2 * n) + ["crash"] * n),
        "terrain": each(grounds),
        "randomize": True,
        "obs": "egocentric+action",
    }
