"""Episodes as they happen, in a viewer of our own: `render_mode="rerun"`."""

import atexit
from typing import Any

import numpy as np
import rerun as rr

from flipcar_env import reward
from flipcar_env.env import FlipCarEnv
from flipcar_env.rollout import frame, gathered

from . import entities, layout, viewer
from .write import PAUSE


class Live:
    """A viewer that shows an environment's steps; where there is no screen, a server to watch from elsewhere.

    It ends with `close`, or with this process, whichever is first.

    Args:
        env: to show.
        headless: a viewer without a window.
    """

    def __init__(self, env: FlipCarEnv, headless: bool = False):
        self.env = env
        self.process, self.url = viewer.start(headless)
        atexit.register(self.close)
        self.stream = rr.RecordingStream("flipcar")
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self.stream.connect_grpc(self.url, default_blueprint=layout.single(None))
        entities.send_static(self.stream, list(reward.TERMS))
        self.start = self.next = 0.0

    def begin(self, info: dict[str, Any]) -> None:
        """Show the start of an episode, of which the reset gave this info."""
        self.start = self.next
        self.frame = frame(self.env, info)
        self._show(begins=True)

    def go_on(self, info: dict[str, Any], action: np.ndarray, total: float) -> None:
        """Show a step, which gave this info and this reward."""
        self.frame = frame(self.env, info, action, total, self.frame)
        self._show()

    def _show(self, begins: bool = False) -> None:
        episode = gathered(self.env, [self.frame], "live")
        now = self.start + self.frame["t"]
        if begins:
            entities.send_ground(self.stream, episode, now)
        entities.send_rows(self.stream, episode, np.array([now]), "live")
        self.next = now + PAUSE

    def close(self) -> None:
        """End the viewer."""
        atexit.unregister(self.close)
        self.stream.disconnect()
        viewer.end(self.process)
