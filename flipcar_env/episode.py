"""One episode as arrays: what a recording, a table or a plot is made from."""

from dataclasses import dataclass, field

import numpy as np

from solver.rotation import to_matrix

from . import car, terrain


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
        offset: (3,) of the centre of mass from the nominal car's, car's axes, m.
        terrain: kind of ground.
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
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    terrain: str = "level"
    start: str = ""
    policy: str = ""
    is_success: bool = False

    @property
    def time_to_upright(self) -> float | None:
        """Seconds from the start to the end of a successful episode; None without success."""
        return float(self.t[-1]) if self.is_success else None


PHASES = ("air", "impact", "upright", "resting", "sliding", "rolling", "rocking")
"""Every value that `phases` returns."""

BLOW = 3.0
"""Times its weight: a car on which the ground pushes harder, over a whole control step, has been struck."""


def touching(episode: Episode) -> np.ndarray:
    """(T, p): does the hull point carry a force?"""
    return np.linalg.norm(episode.force, axis=2) > 0.0


def hull_points(episode: Episode) -> tuple[np.ndarray, np.ndarray]:
    """Each hull point's place nearest to the ground, and the ground's normal there: both (T, p, 3), world."""
    hull = np.array(list(car.HULL.values()))  # (p, 4)
    turned = np.einsum("tij,pj->tpi", to_matrix(episode.quat), hull[:, :3] - episode.offset)
    centres = episode.x[:, None, :] + turned
    normals = terrain.surface(episode.terrain).feet(centres)[..., 1:4]
    return centres - hull[None, :, 3:] * normals, normals


def slip(episode: Episode) -> np.ndarray:
    """(T,) m/s: how fast the points that carry the car move along the ground, weighted by what they carry."""
    points, normals = hull_points(episode)
    v = episode.v[:, None, :] + np.cross(episode.w[:, None, :], points - episode.x[:, None, :])
    along = v - (v * normals).sum(axis=2, keepdims=True) * normals
    load = np.linalg.norm(episode.force, axis=2)
    total = load.sum(axis=1)
    return (load * np.linalg.norm(along, axis=2)).sum(axis=1) / np.where(total > 0.0, total, 1.0)


def phases(episode: Episode) -> list[str]:
    """What the car is doing at each step, one of `PHASES`; the first rule that fits.

    - air: no contact force;
    - impact: the ground pushes with more than `BLOW` times the car's weight;
    - upright: only tyres touch, tilt below 15°;
    - resting: slower than 0.05 m/s and 0.05 rad/s;
    - sliding: what touches slips over the ground faster than 0.5 m/s;
    - rolling: turns about a level axis faster than 1.5 rad/s;
    - rocking: everything else.

    Row 0 has no force by definition and takes the phase of row 1.
    """
    touches = touching(episode)
    push = np.linalg.norm(episode.force.sum(axis=1), axis=1)
    on_tyres_only = ~touches[:, car.N_WHEELS :].any(axis=1)
    speed, spin = np.linalg.norm(episode.v, axis=1), np.linalg.norm(episode.w, axis=1)
    rules = {
        "air": ~touches.any(axis=1),
        "impact": push > BLOW * car.MASS * 9.81,
        "upright": on_tyres_only & (episode.tilt < np.radians(15.0)),
        "resting": (speed < 0.05) & (spin < 0.05),
        "sliding": slip(episode) > 0.5,
        "rolling": np.hypot(episode.w[:, 0], episode.w[:, 1]) > 1.5,
    }
    found = np.select(list(rules.values()), list(rules), default="rocking").tolist()
    return found[1:2] + found[1:] if len(found) > 1 else found
