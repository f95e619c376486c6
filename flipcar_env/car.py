"""The rally car: mass, inertia, hull and torque limits. SI units; x forward, y left, z up.

A 2006-class rally car at the rules' minimum mass. Heights are given above the ground of the
upright car, as one would measure them on a real one; the body frame's origin is the centre of mass.
"""

import numpy as np

from solver import Body

MASS = 1230.0
"""kg, the class's minimum."""

INERTIA = (450.0, 1900.0, 2100.0)
"""kg m², roll, pitch and yaw, about the centre of mass."""

CENTRE_OF_MASS_HEIGHT = 0.48
"""m above the ground, upright."""

TORQUE_LIMIT = (3100.0, 3100.0, 3100.0)
"""N m about roll, pitch and yaw. From the roof a constant torque of this size hardly ever recovers
the car (0.03 of starts, mean over 26 directions) and a controller to upright never does, while
pumping along the roll rate always does; at 3000 pumping begins to fail, at 3250 constant torque to work."""

FRICTION = 0.8
"""Coulomb's μ of car on ground."""

RESTITUTION = 0.0
"""Bodywork crumples; tyres are locked and stiff."""

# What `randomize` draws anew for each episode, uniformly: the nominal car plus or minus a share, or a range.
MASS_SPREAD = 0.15
"""A crew of two, fuel and a spare wheel weigh 200 kg, 16 % of the bare car."""

INERTIA_SPREAD = 0.15
"""Of each axis, beside what the mass brings: 80 kg moved from the middle to both bumpers is 18 % in yaw."""

OFFSET_SPREAD = (0.08, 0.05, 0.04)
"""m, forward, left, up. 8 cm forward and 5 cm to the left are 3 % of the weight from axle to axle and
from side to side; 4 cm up is a suspension raised for gravel."""

FRICTION_RANGE = (0.4, 1.0)
"""From wet grass under sheet metal to rubber on dry tarmac."""

RESTITUTION_RANGE = (0.0, 0.2)
"""Bodywork crumples; tyres and the roll cage spring back a little."""

LIMIT_SPREAD = 0.1
"""What a motor's rating and its supply leave open."""

WHEELBASE = 2.5
WHEEL_RADIUS = 0.32
TYRE_RADIUS = 0.08
"""m; a tyre touches the ground with a rounded shoulder."""

# name: (x, y, height above the ground, radius); every y > 0 is mirrored to the right side.
_HALF_HULL = {
    "tyre_front": (1.25, 0.72, 0.08, TYRE_RADIUS),
    "tyre_rear": (-1.25, 0.72, 0.08, TYRE_RADIUS),
    "bumper_front": (2.20, 0.75, 0.45, 0.0),
    "bumper_rear": (-2.20, 0.75, 0.45, 0.0),
    "arch_front": (1.25, 0.90, 0.50, 0.0),
    "arch_rear": (-1.25, 0.90, 0.50, 0.0),
    "shoulder_front": (1.00, 0.84, 0.80, 0.0),
    "shoulder_rear": (-1.30, 0.84, 0.80, 0.0),
    "bonnet": (1.75, 0.65, 0.80, 0.0),
    "spoiler": (-1.95, 0.60, 1.15, 0.0),
    "rail_front": (0.40, 0.58, 1.31, 0.0),
    "rail_rear": (-1.25, 0.58, 1.31, 0.0),
    "crown_front": (0.40, 0.0, 1.36, 0.0),
    "crown_rear": (-1.25, 0.0, 1.36, 0.0),
}


def _mirrored() -> dict[str, tuple[float, float, float, float]]:
    points = {}
    for name, (x, y, height, radius) in _HALF_HULL.items():
        z = height - CENTRE_OF_MASS_HEIGHT
        if y == 0.0:
            points[name] = (x, y, z, radius)
        else:
            points[name + "_left"] = (x, y, z, radius)
            points[name + "_right"] = (x, -y, z, radius)
    return points


HULL = _mirrored()
"""Name of each hull point: (x, y, z, radius) in the body frame, m. Tyres come first."""

N_WHEELS = 4
"""The first so many hull points are tyres."""

NOMINAL = np.array([MASS, *INERTIA, 0.0, 0.0, 0.0, FRICTION, RESTITUTION, *TORQUE_LIMIT])
"""(12,) the car as its columns in a row (`row.CAR`): mass, inertia, offset of the centre of mass,
friction, restitution, torque limits."""


def _ranges() -> np.ndarray:
    spread = np.concatenate(
        [[MASS_SPREAD], np.full(3, INERTIA_SPREAD), np.zeros(5), np.full(3, LIMIT_SPREAD)]
    )
    ranges = np.stack([NOMINAL * (1.0 - spread), NOMINAL * (1.0 + spread)], axis=1)
    ranges[4:7, 0], ranges[4:7, 1] = np.negative(OFFSET_SPREAD), OFFSET_SPREAD
    ranges[7], ranges[8] = FRICTION_RANGE, RESTITUTION_RANGE
    return ranges


RANGES = _ranges()
"""(12, 2) least and most of each; of the inertia at the nominal mass, with which it grows."""


def body() -> Body:
    """The car as the solver sees it."""
    points = np.array(list(HULL.values()))
    return Body(MASS, INERTIA, points[:, :3], radius=points[:, 3])
