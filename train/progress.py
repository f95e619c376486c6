"""What one wants to see while an agent trains, and how its noise falls."""

from math import log
from pathlib import Path

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import CSVOutputFormat, Logger, TensorBoardOutputFormat
from tqdm import tqdm


def logger(out: Path, done: int = 0) -> Logger:
    """The learning curve goes to progress.csv and to TensorBoard.

    Args:
        out: run directory.
        done: steps; what the curve has of them stays, as a run that was cut off went further.
    """
    curve = out / "progress.csv"
    lines = curve.read_text().splitlines(keepends=True) if done and curve.exists() else []
    table = CSVOutputFormat(str(curve))
    if lines:
        table.keys = lines[0].strip().split(",")
        at = table.keys.index("time/total_timesteps")
        kept = [line for line in lines[1:] if line.endswith("\n") and int(line.split(",")[at]) <= done]
        table.file.writelines([lines[0], *kept])
        table.file.flush()
    return Logger(str(out), [table, TensorBoardOutputFormat(str(out))])


class ProgressBar(BaseCallback):
    """Steps done, to go and per second; success rate and return of the last hundred episodes.

    Args:
        steps: in all.
    """

    def __init__(self, steps: int):
        super().__init__()
        self.steps = steps

    def _on_training_start(self) -> None:
        self.bar = tqdm(
            total=self.steps, initial=self.num_timesteps, unit=" steps", unit_scale=True, smoothing=0.05
        )

    def _on_step(self) -> bool:
        self.bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer
        successes = self.model.ep_success_buffer
        if episodes and successes:
            self.bar.set_postfix(
                success=f"{sum(successes) / len(successes):.0%}",
                reward=f"{sum(e['r'] for e in episodes) / len(episodes):.2f}",
                refresh=False,
            )

    def _on_training_end(self) -> None:
        self.bar.close()


class LessNoise(BaseCallback):
    """Before each rollout of PPO, bound the standard deviation of the actions: from 1 to `least`, as a power.

    Args:
        least: at the end.
    """

    def __init__(self, least: float):
        super().__init__()
        self.least = least

    def _on_rollout_start(self) -> None:
        done = self.num_timesteps / self.model._total_timesteps
        with torch.no_grad():
            self.model.policy.get_parameter("log_std").clamp_(max=done * log(self.least))

    def _on_step(self) -> bool:
        return True
