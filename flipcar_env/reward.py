"""Reward as named terms. The reward is their sum, each already weighted."""

from math import acos

from solver.algebra import jit
from solver.trace import traced

TERMS = ("progress", "success", "time", "effort")

PROGRESS = 2.0
"""Times the change of (1 + cos tilt)/2: a potential, so what is gained by turning up is lost by
falling back, and lying flat or rocking for ever earns nothing."""

SUCCESS = 5.0
"""Once, when the episode ends upright."""

TIME = -0.02
"""Each control step: ten seconds cost what success earns."""

EFFORT = -0.005
"""Times the mean square action: torque costs a little."""

# Success: upright, carried by the wheels, still, for half a second.
COS_TILT = 0.9659258262890683  # cos 15°
STILL_SPEED = 0.5  # m/s
STILL_SPIN = 0.5  # rad/s
HOLD_TIME = 0.5  # s
WHEELS_DOWN = 3  # at least


@traced
def uprightness(up_z):
    """(1 + cos tilt)/2 from the vertical component of the car's up axis: 0 on its roof, 1 upright."""
    return 0.5 * (1.0 + up_z)


@jit
def terms(before, after, success, action):
    """The weighted terms, in the order of TERMS.

    Args:
        before: cos tilt before the step.
        after: cos tilt after it.
        success: did this step complete the half second upright?
        action: (3,) in [-1, 1].
    """
    square = action[0] * action[0] + action[1] * action[1] + action[2] * action[2]
    return (
        PROGRESS * (uprightness(after) - uprightness(before)),
        SUCCESS if success else 0.0,
        TIME,
        EFFORT * square / 3.0,
    )


@jit
def is_still_upright(cos_tilt, speed, spin, wheels_down, others_down):
    """Upright, carried by the wheels alone, and still."""
    return (
        cos_tilt >= COS_TILT
        and speed <= STILL_SPEED
        and spin <= STILL_SPIN
        and wheels_down >= WHEELS_DOWN
        and others_down == 0
    )


@jit
def tilt(cos_tilt):
    """Angle of the car's up axis from the vertical, rad."""
    return acos(min(1.0, max(-1.0, cos_tilt)))
