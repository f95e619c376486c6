"""Keep an environment's episodes as recordings, as they are played."""

from pathlib import Path
from typing import Any

import gymnasium as gym

from flipcar_env.core import whole
from flipcar_env.env import FlipCarEnv
from flipcar_env.rollout import Frame, frame, gathered

from .write import save


class RerunRecorder(gym.Wrapper):
    """Record every so-manyth episode of an environment, each to a file of its own.

    No more than one episode is held in memory; a file is whole as soon as it has its name. Recording only
    reads: states, observations and rewards have the same bits without.

    Args:
        env: a FlipCar environment, wrapped or not.
        folder: for episode-000000.rrd and so on; made if it is not there.
        every: 1 for all episodes, 100 for each hundredth, the first included.
        name: of who drives, for titles.

    Raises:
        ValueError: not such an environment, or `every` is no whole number from 1 on.
    """

    def __init__(self, env: gym.Env, folder: str | Path, every: int = 1, name: str = ""):
        super().__init__(env)
        if not isinstance(env.unwrapped, FlipCarEnv):
            raise ValueError(f"env must be a FlipCar environment, got {env.unwrapped!r}")
        self.every = whole("every", every, 1)
        self.folder, self.name = Path(folder), name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.episodes = 0
        self._frames: list[Frame] = []

    def reset(self, **arguments: Any):
        """As the environment's; an episode that was not over is kept as it is."""
        self._keep()
        obs, info = self.env.reset(**arguments)
        if self.episodes % self.every == 0:
            self._frames = [frame(self._car, info)]
        self.episodes += 1
        return obs, info

    def step(self, action):
        """As the environment's."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        if self._frames:
            self._frames.append(frame(self._car, info, action, float(reward), self._frames[-1]))
            if terminated or truncated:
                self._keep()
        return obs, reward, terminated, truncated, info

    def close(self) -> None:
        """As the environment's; an episode that is not over is kept as it is."""
        self._keep()
        super().close()

    @property
    def _car(self) -> FlipCarEnv:
        return self.env.unwrapped  # type: ignore[return-value]

    def _keep(self) -> None:
        if self._frames:
            frames, self._frames = self._frames, []
            episode = gathered(self._car, frames, self.name)
            save(self.folder / f"episode-{self.episodes - 1:06d}.rrd", [episode])
