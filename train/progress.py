"""A progress bar with what one wants to know while an agent trains."""

from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm


class ProgressBar(BaseCallback):
    """Steps done and per second, success rate and return of the last hundred episodes.

    Args:
        steps: in all.
    """

    def __init__(self, steps: int):
        super().__init__()
        self.steps = steps

    def _on_training_start(self) -> None:
        self.bar = tqdm(total=self.steps, unit=" steps", unit_scale=True, smoothing=0.05)

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
            )

    def _on_training_end(self) -> None:
        self.bar.close()
