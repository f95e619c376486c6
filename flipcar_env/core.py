"""What every kind of environment is made of: rows, buffers and settings, stepped by compiled code."""

from typing import Any

import numpy as np
from gymnasium import spaces

from solver import METHODS, Plane
from solver.errors import finite, number, one_of
from solver.scene import UNIT_TOLERANCE

from . import car, observe, reward, starts, task
from . import row as r

GRAVITY = 9.81
EPISODE_TIME = 10.0
"""s."""

TERRAINS = ("level",)


class Core:
    """The rows, buffers and settings that every kind of environment is made of.

    Args:
        n: how many environments.
        start: kind of start, or "any".
        terrain: "level".
        obs: "egocentric" or "state".
        control_dt: s between actions.
        substeps: physics steps in each.
        method: contact method.
    """

    def __init__(
        self,
        n: int = 1,
        start: str = "any",
        terrain: str = "level",
        obs: str = "egocentric",
        control_dt: float = 0.04,
        substeps: int = 10,
        method: str = "impulse",
    ):
        if not isinstance(n, int | np.integer) or n < 1:
            raise ValueError(f"num_envs must be a whole number >= 1, got {n!r}")
        one_of("start", start, (*starts.KINDS, "any"))
        one_of("terrain", terrain, TERRAINS)
        one_of("obs", obs, observe.KINDS)
        control_dt = number("control_dt", control_dt, above=0.0, high=0.5)
        if not isinstance(substeps, int | np.integer) or not 1 <= substeps <= 1000:
            raise ValueError(f"substeps must be a whole number from 1 to 1000, got {substeps!r}")
        if one_of("method", method, METHODS) != "impulse":
            raise ValueError(f"method must be 'impulse' in the environment, got {method!r}")
        body = car.body()
        self.start = start
        self.obs_kind = obs
        self.control_dt = control_dt
        self.points = len(body.hull)
        self.model = r.model(
            body,
            Plane(),
            (car.FRICTION, car.RESTITUTION),
            GRAVITY,
            car.TORQUE_LIMIT,
            car.N_WHEELS,
            control_dt,
            int(substeps),
            round(EPISODE_TIME / control_dt),
            int(np.ceil(reward.HOLD_TIME / control_dt - 1e-9)),
            obs == "egocentric",
        )
        settling = self.model.copy()
        settling[r.EGOCENTRIC] = 0.0  # what is seen does not change how the car settles
        self.bank = starts.settled_bank(settling.tobytes())
        self.rows = np.zeros((n, r.width(self.points)))
        self.states = self.rows[:, : r.state_width(self.points)]
        first = r.results(self.points)
        self.results = self.rows[:, first : first + r.RESULTS]
        self.observation_space = observe.space(obs)
        observed = self.rows.view(np.float32)[:, 2 * (first + r.RESULTS) :]
        self.observed = observed[:, : self.observation_space.shape[0]]
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)

    def set_key(self, i: int, seed: int) -> None:
        """Give environment i the random stream of a seed, from its first episode."""
        self.rows[i, r.KEY] = (seed >> 32) & 0xFFFFFFFF
        self.rows[i, r.KEY + 1] = seed & 0xFFFFFFFF
        self.rows[i, r.EPISODE] = -1

    def begin(self, i: int, start: str) -> None:
        """Start environment i's next episode."""
        kind = starts.ANY if start == "any" else starts.KINDS.index(start)
        self.rows[i, r.EPISODE] += 1
        starts.begin(self.model, self.bank, self.rows[i], kind)
        task.look(self.model, self.rows[i])

    def step(self, actions: np.ndarray) -> None:
        """One control step of all, from (n, 3) float32 actions, in place.

        Raises:
            ValueError: an action is not finite; nothing has changed then.
        """
        bad = task.step(self.model, self.rows, actions)
        if bad >= 0:
            raise ValueError(f"action must be finite, got {actions[bad].tolist()}")

    def info(self, i: int, results: list[float]) -> dict[str, Any]:
        """The info of environment i after a step, from its results."""
        # Names for all, once, and literals: anything neater costs as much as the physics.
        progress, won, time, effort, _, _, _, success, energy, tilt, contacts, work, failed = results
        info = {
            "is_success": success != 0.0,
            "energy": energy,
            "work": work,
            "tilt": tilt,
            "n_contacts": int(contacts),
            "reward_terms": {"progress": progress, "success": won, "time": time, "effort": effort},
        }
        if success:
            info["time_to_upright"] = float(self.rows[i, r.STEPS]) * self.control_dt
        if failed:
            info["solver_error"] = "the state was no longer finite; the last good one was kept"
        return info

    def start_info(self, i: int) -> dict[str, Any]:
        """The info of environment i after a reset."""
        info = self.info(i, self.results[i].tolist())
        info["work"] = float(self.rows[i, r.WORK])
        info["start"] = starts.KINDS[int(self.rows[i, r.START])]
        return info

    def observations(self) -> np.ndarray:
        """(n, k) float32, freshly made."""
        return self.observed.copy()

    def check_state(self, state: Any) -> np.ndarray:
        """A state array as `get_state` gives it.

        Raises:
            ValueError: wrong shape, not finite, or its quaternion is not a unit one.
        """
        array = finite("state", state, (self.states.shape[1],))
        norm = float(np.linalg.norm(array[3:7]))
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"state's quaternion (entries 3 to 6) must have norm 1, got {norm:g}")
        if not 0 <= array[r.START] < len(starts.KINDS):
            raise ValueError(
                f"state's start (entry {r.START}) must be 0 to {len(starts.KINDS) - 1}, "
                f"got {array[r.START]:g}"
            )
        return array
