"""Play episodes and keep them. Recording only reads: the physics is bitwise that of an episode without."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from solver.model import load
from solver.rotation import to_matrix

from . import reward
from . import row as r
from .env import FlipCarEnv
from .episode import Episode

Frame = dict[str, Any]
"""One row of an episode: its arrays' names, and values."""


def play(
    env: FlipCarEnv,
    policy: Callable[[np.ndarray], np.ndarray],
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    name: str = "",
) -> Episode:
    """One episode.

    Args:
        env: the environment itself, not a wrapper (`gym.make(...).unwrapped`).
        policy: observation (k,) to action (3,).
        seed: of the reset.
        options: of the reset.
        name: of the policy, for titles.
    """
    obs, info = env.reset(seed=seed, options=options)
    frames, done = [frame(env, info)], False
    while not done:
        obs, done = _step(env, policy(obs), frames)
    return gathered(env, frames, name)


def replay(env: FlipCarEnv, state: np.ndarray, actions: Iterable[np.ndarray], name: str = "") -> Episode:
    """What these actions make of a state: to the bit what they made of it elsewhere, alone or in a batch.

    Args:
        env: with the same settings.
        state: as `get_state` gives it.
        actions: (3,) each, at most to the episode's end.
        name: of the policy, for titles.
    """
    _obs, info = env.reset(options={"state": state})
    frames = [frame(env, info)]
    for action in actions:
        _step(env, action, frames)
    return gathered(env, frames, name)


def _step(env: FlipCarEnv, action: np.ndarray, frames: list[Frame]) -> tuple[np.ndarray, bool]:
    """Step, and keep a frame; returns the observation, and if the episode is over."""
    obs, total, terminated, truncated, info = env.step(action)
    frames.append(frame(env, info, action, total, frames[-1]))
    return obs, terminated or truncated


def frame(
    env: FlipCarEnv,
    info: dict[str, Any],
    action: np.ndarray | None = None,
    total: float = 0.0,
    before: Frame | None = None,
) -> Frame:
    """What there is to keep of a control step, or of a start.

    Args:
        env: after the step, or the reset.
        info: that it gave.
        action: that was given; None at a start.
        total: reward.
        before: the frame before; None at a start.
    """
    dt, state = env.core.control_dt, env.get_state()
    x, quat, v, w = (np.array(a) for a in load(state))
    given = np.zeros(3) if action is None else np.clip(np.asarray(action, np.float32), -1.0, 1.0)
    delay = env.core.settings["action_delay"]
    due = given if before is None or delay == 0 else before["given"][-delay]
    return {
        "t": 0.0 if before is None else before["step"] * dt + dt,
        "step": 0 if before is None else before["step"] + 1,
        "given": state[r.GIVEN : r.FORCES].reshape(-1, 3),
        "start": info.get("start", "state") if before is None else before["start"],
        "x": x,
        "quat": quat,
        "v": v,
        "w": to_matrix(quat) @ w,
        "action": given,
        "torque": due * state[r.LIMIT : r.LIMIT + 3],
        "force": np.zeros((env.core.points, 3)) if before is None else env.contact_impulses() / dt,
        "tilt": info["tilt"],
        "energy": info["energy"],
        "work": info["work"],
        "reward": total,
        "is_success": info["is_success"],
        **info["reward_terms"],
    }


COLUMNS = ("t", "x", "quat", "v", "w", "action", "torque", "force", "tilt", "energy", "work", "reward")
"""Of an episode, each an array of what the frames have."""


def gathered(env: FlipCarEnv, frames: list[Frame], name: str = "") -> Episode:
    """Frames as an episode.

    Args:
        env: that they are from.
        frames: at least one.
        name: of the policy, for titles.
    """
    return Episode(
        **{key: np.array([one[key] for one in frames]) for key in COLUMNS},
        reward_terms={term: np.array([one[term] for one in frames]) for term in reward.TERMS},
        offset=env.get_state()[r.OFFSET : r.OFFSET + 3],
        terrain=env.core.terrains[0],
        start=frames[0]["start"],
        policy=name,
        is_success=frames[-1]["is_success"],
    )
