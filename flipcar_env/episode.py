"""One episode as arrays: what a recording, a table or a plot is made from."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Episode:
    """One row a control step; row 0 is the start (zero action, zero force). World frame, SI units.

    Attributes:
        t: (T,) s.
        x: (T, 3) centre of mass, m.
        quat: (T, 4) w, x, y, z, body to world.
        v: (T, 3) m/s.
        w: (T, 3) rad/s.
        action: (T, 3) roll, pitch, yaw, in [-1, 1].
        torque: (T, 3) N m, body axes.
        force: (T, p, 3) mean contact force on each hull point over the control step, N.
        tilt: (T,) angle of the car's up axis from the vertical, rad.
        energy: (T,) mechanical, J.
        work: (T,) the actuator's integral of |torque · w|, J.
        reward: (T,) total.
        reward_terms: name to (T,), weighted; their sum is `reward`.
        start: kind of start.
        policy: who drove.
        is_success: did the episode end upright?
    """

    t: np.ndarray
    x: np.ndarray
    quat: np.ndarray
    v: np.ndarray
    w: np.ndarray
    action: np.ndarray
    torque: np.ndarray
    force: np.ndarray
    tilt: np.ndarray
    energy: np.ndarray
    work: np.ndarray
    reward: np.ndarray
    reward_terms: dict[str, np.ndarray] = field(default_factory=dict)
    start: str = ""
    policy: str = ""
    is_success: bool = False

    @property
    def time_to_upright(self) -> float | None:
        """Seconds from the start to the end of a successful episode; None without success."""
        return float(self.t[-1]) if self.is_success else None
