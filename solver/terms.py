"""Which terms of the equations a scene needs: a kernel is compiled for those alone.

A kernel takes them as `law`, a tuple (μ, e, gyroscopic, several) in which None stands for a term that
is left out. None is a type of its own, so each choice is another specialisation, which numba's cache on
disk keeps; `if mu is None` is decided before the code behind it is even typed. Where a term is zero,
leaving it out changes no bit: tests compare with `full`.
"""

import numpy as np

from .body import Body

Law = tuple[float | None, float | None, bool | None, bool | None]


def needed(body: Body, friction: float, restitution: float) -> Law:
    """The terms of a scene: what is zero in it is None.

    Args:
        body: its J has no gyroscopic term if it is a multiple of the identity; one hull point needs
            no sweep.
        friction: μ.
        restitution: e.
    """
    return (
        friction if friction > 0.0 else None,
        restitution if restitution > 0.0 else None,
        None if np.ptp(body.principal_J) == 0.0 else True,
        True if len(body.hull) > 1 else None,
    )


def full(friction: float, restitution: float) -> Law:
    """Every term, needed or not: to set a scene's `law` to, for comparison."""
    return friction, restitution, True, True
