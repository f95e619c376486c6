"""What one wants to see while an agent trains."""

from pathlib import Path

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


class Recordings(BaseCallback):
    """Record an episode from the roof every so often, for rerun, in an environment of its own.

    Args:
        out: run directory; they go to recordings/.
        every: steps between them, at least.
    """

    def __init__(self, out: Path, every: int):
        super().__init__()
        self.folder, self.every, self.next = out / "recordings", every, 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        from flipcar_env import recording, rollout
        from flipcar_env.env import FlipCarEnv
        from flipcar_env.policy import Policy

        from .learner import exported

        if self.num_timesteps < self.next:
            return
        self.next = self.num_timesteps + self.every
        self.folder.mkdir(exist_ok=True)
        layers, obs, squash = exported(self.model)
        policy = Policy(layers, obs, squash)
        name = f"{self.num_timesteps:010d}"
        episode = rollout.play(FlipCarEnv(obs=obs), policy, 0, {"start": "roof"}, f"after {name} steps")
        recording.save(self.folder / f"{name}.rrd", [episode])
