"""The grounds, by name: each is the same in every environment and every episode.

Success is judged against the vertical, so they are such that an upright car can stand on its wheels
anywhere, tilted by 13° at most where 15° are allowed, and does not slide, even with the least friction
that `randomize` draws.
"""

from functools import cache
from math import cos, radians, sin

from solver import HeightField, Plane

from .observe import FIELD

KINDS = ("level", "slope", "bumpy", "ditch")

SLOPE = radians(10.0)
"""rad, falling towards x: a steep road, on which a friction of 0.18 holds a car."""

BUMP_HEIGHT = 0.15
"""m up and down: from the lowest to the highest about a wheel's radius. Wheels on them tilt the car by up
to 9.5°, and half of the time by more than 3°."""

BUMP_SPACING = 2.5
"""m, a wheelbase: a car on its roof rests on two or three humps."""

BUMP_SEED = 1

DITCH_DEPTH = 0.8
"""m: a car that lies on its side in it hardly looks out."""

DITCH_WIDTH = 6.0
"""m: its banks, 12.9° at the steepest, are clear of the bumpers of a car that stands across it."""

SCATTER = 3.0
"""m: where the ground is not the same everywhere, starts are within ± so much of the origin in x and y."""


@cache
def surface(kind: str) -> Plane | HeightField:
    """The ground of that name, through the origin or near it."""
    if kind == "bumpy":
        return HeightField.named(
            "bumpy", height=BUMP_HEIGHT, spacing=BUMP_SPACING, size=2.0 * FIELD, seed=BUMP_SEED
        )
    if kind == "ditch":
        return HeightField.named("ditch", depth=DITCH_DEPTH, width=DITCH_WIDTH)
    return Plane((sin(SLOPE), 0.0, cos(SLOPE))) if kind == "slope" else Plane()
