"""Keep a run, so that it can go on to the same bits after it was cut off."""

import io
import os
import random
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback

FILE = "checkpoint.pkl"

EVERY = 50_000
"""Steps between checkpoints, at least."""


def save(path: Path, model: Any) -> None:
    """Keep all that the rest of a run depends on, between two rollouts; the file is never half a one."""
    file = io.BytesIO()
    model.save(file)
    env = model.get_vec_normalize_env()
    kept = {
        "algorithm": type(model).__name__,
        "model": file.getvalue(),
        "scaling": env,  # without its cars and its returns
        "returns": env.returns,
        "cars": env.venv,
        "logged": [  # of the last update, written with the next rollout
            (name, value, model.logger.name_to_excluded[name])
            for name, value in model.logger.name_to_value.items()
        ],
        "buffer": getattr(model, "replay_buffer", None),
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002 (SB3's)
    }
    new = path.with_suffix(".new")
    with new.open("wb") as out:
        cloudpickle.dump(kept, out)
        out.flush()
        os.fsync(out.fileno())
    new.replace(path)


def load(path: Path) -> tuple[Any, list[tuple]]:
    """(model, what is still to be logged): as it was, its cars and the random numbers to come, too."""
    with path.open("rb") as file:
        kept = cloudpickle.load(file)
    torch.set_num_threads(1)
    env = kept["scaling"]
    env.set_venv(kept["cars"])
    env.returns = kept["returns"]
    seeds = list(kept["cars"]._seeds)
    algorithms: dict[str, type[PPO | SAC]] = {"PPO": PPO, "SAC": SAC}
    model: Any = algorithms[kept["algorithm"]].load(
        io.BytesIO(kept["model"]), env=env, force_reset=False, device="cpu"
    )
    if kept["buffer"] is not None:
        model.replay_buffer = kept["buffer"]
    kept["cars"]._seeds = seeds  # loading seeds everything anew
    random.setstate(kept["random"][0])
    np.random.set_state(kept["random"][1])  # noqa: NPY002
    torch.set_rng_state(kept["random"][2])
    return model, kept["logged"]


class Checkpoints(BaseCallback):
    """Keep the run every so often.

    Args:
        out: run directory.
        every: steps between checkpoints, at least.
    """

    def __init__(self, out: Path, every: int = EVERY):
        super().__init__()
        self.path, self.every, self.last = out / FILE, every, 0

    def _on_training_start(self) -> None:
        self.last = self.num_timesteps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last >= self.every:
            save(self.path, self.model)
            self.last = self.num_timesteps
