"""Play one episode and keep it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from solver.model import load
from solver.rotation import to_matrix

from . import reward
from .env import FlipCarEnv
from .episode import Episode
from .row import LIMIT


def play(
    env: FlipCarEnv,
    policy: Callable[[np.ndarray], np.ndarray],
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    name: str = "",
) -> Episode:
    """One episode, recorded. Recording only reads: the physics is bitwise that of an episode without.

    Args:
        env: the environment itself, not a wrapper (`gym.make(...).unwrapped`).
        policy: observation (k,) to action (3,).
        seed: of the reset.
        options: of the reset.
        name: of the policy, for titles.
    """
    obs, info = env.reset(seed=seed, options=options)
    start = info.get("start", "state")
    frames = [_frame(env, 0, np.zeros(3), info, 0.0)]
    done = False
    while not done:
        action = np.clip(np.asarray(policy(obs), dtype=np.float32), -1.0, 1.0)
        obs, total, terminated, truncated, info = env.step(action)
        frames.append(_frame(env, len(frames), action, info, total))
        done = terminated or truncated
    columns = {key: np.array([frame[key] for frame in frames]) for key in frames[0]}
    terms = {term: columns.pop(term) for term in reward.TERMS}
    return Episode(
        **columns,
        reward_terms=terms,
        start=start,
        policy=name,
        is_success=info["is_success"],
    )


def _frame(
    env: FlipCarEnv, step: int, action: np.ndarray, info: dict[str, Any], total: float
) -> dict[str, Any]:
    dt = env.core.control_dt
    state = env.get_state()
    x, quat, v, w = (np.array(a) for a in load(state))
    return {
        "t": step * dt,
        "x": x,
        "quat": quat,
        "v": v,
        "w": to_matrix(quat) @ w,
        "action": action,
        "torque": action * state[LIMIT : LIMIT + 3],
        "force": env.contact_impulses() / dt if step else np.zeros((env.core.points, 3)),
        "tilt": info["tilt"],
        "energy": info["energy"],
        "work": info["work"],
        "reward": total,
        **info["reward_terms"],
    }
