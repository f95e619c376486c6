"""The scenes of the stability map: each asks one yes-or-no question of whatever plays it.

Tolerances are loose, mostly 10 %: the question is whether the answer is of the right kind. How accurate
it is, others measure. A batch of a few starts that differ a little keeps luck out: all must be right.
"""

from solver.chart.stability_case import Case
from solver.chart.stability_several import (
    BASE,
    box_drop,
    column,
    comes_out,
    comes_to_lie,
    corner,
    creeps_not,
    dip,
    edge,
    evenly,
    gains_nothing,
    is_seen,
    lands,
    outside,
    overlap,
    painleve,
    rocking,
    rocks,
    rod_slope,
    slope,
    stays,
    stops_there,
    strike,
    throw,
)
from solver.chart.stability_single import (
    ball,
    bounces_on,
    bullet,
    keeps_energy,
    precesses,
    rest_after,
    settles,
    slender,
    spin,
    stopped,
    tippe,
    top,
    turns_over,
)

CASES = (
    Case(
        "free-spin", "Turning over and over for 60 s: is the energy within 10 % all the time?",
        "spin", "rad/s", (1, 3, 10, 30, 100, 300, 1000), 10, spin, keeps_energy, 60,
    ),
    Case(
        "slender-spin", "A coning body for 10 s: are energy and quaternion's length within 10 %?",
        "inertia ratio", "", (2, 5, 10, 30, 100, 300, 1000), 10, slender, keeps_energy, 60,
    ),
    Case(
        "lossless-bounce", "A ball with e = 1: does it come as high as it was dropped from, within 10 %?",
        "time", "s", (1, 3, 5, 10, 20, 60), 20, lambda T: ball(1.0, T), bounces_on,
    ),
    Case(
        "settling-ball", "Is the first rebound e² of the drop within 10 %, and is it at rest in time?",
        "restitution", "", (0.3, 0.5, 0.7, 0.8, 0.9, 0.95), 0.8,
        lambda e: ball(e, 1.2 * rest_after(e) + 0.5), settles,
    ),
    Case(
        "bullet", "A 5 cm ball is shot down: never deeper than its radius, and lying there at the end?",
        "speed", "m/s", (1, 3, 10, 30, 100, 300), 30, bullet, stopped,
    ),
    Case(
        "top", "A top on a frictionless tip for 4 s: tip within 1 mm of the ground, height within 10 %?",
        "spin", "rad/s", (10, 30, 100, 300, 1000), 30, top, precesses,
    ),
    Case(
        "tippe-top", "Does the tippe top, which turns over after 4 s, do so between 3 and 6 s?",
        "spin", "rad/s", (100,), 100, tippe, turns_over,
    ),
    Case(
        "standing-column", "For 10 s: does no corner move by 1 mm, and is no energy gained?",
        "slenderness", "", (1, 2, 5, 10, 20, 50, 100), 5, column, stays, 15,
    ),
    Case(
        "slope", "A block inside the friction cone: does it creep less than 1 mm in 10 s?",
        "slope", "of μ", (0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99), 0.5, slope, creeps_not, 15,
    ),
    Case(
        "throw", "A block slides: does it stop where v²/2μg says within 10 %, within 3° of the throw?",
        "speed", "m/s", (1, 3, 10, 30, 100), 3, throw, stops_there, 60,
    ),
    Case(
        "flat-landing", "A box lands flat, e = 0: is the rebound below 1 % of the drop, and it stands?",
        "slenderness", "", (1, 2, 5, 10, 20), 2, lambda s: box_drop((*BASE, BASE[0] * s), 0.0), lands,
    ),
    Case(
        "flat-rebound", "A flat box lands flat: is the rebound e² of the drop, within 10 %?",
        "restitution", "", (0.1, 0.25, 0.5, 0.75, 1), 0.5, lambda e: box_drop((0.4, 0.3, 0.2), e), lands,
    ),
    Case(
        "overlap", "A box starts in the ground: does it come out, no higher than it was deep?",
        "depth", "mm", (0.1, 1, 3, 10), 10, overlap, comes_out,
    ),
    Case(
        "spinning-corner", "A spinning box hits the ground: never 1 cm deep, no energy gained?",
        "spin", "rad/s", (10, 30, 100, 300, 1000, 3000), 300, corner, outside,
    ),
    Case(
        "dip", "The end of a spinning rod dips 1 mm below the ground: is it thrown back?",
        "spin", "rad/s", (5, 10, 20, 40, 100, 300, 1000), 40, dip, is_seen,
    ),
    Case(
        "rocking", "Housner's block: first impact in time and energy left by it, within 10 %?",
        "slenderness", "", (2, 3, 5, 10), 3, rocking, rocks,
    ),
    Case(
        "edge", "A box tips over about its edge: do both ends stay down, without chatter?",
        "tilt", "rad", (0.7,), 0.7, edge, evenly,
    ),
    Case(
        "rod-strike", "A 45° rod strikes with e = 1 in twelve directions: does none gain energy?",
        "friction", "", (0.1, 0.25, 0.5, 0.75, 1, 1.25, 1.5), 0.5, strike, gains_nothing,
    ),
    Case(
        "painleve-rod", "A rod slides on its end: does it go on, without energy gained or sinking 1 cm?",
        "friction", "", (0.3, 0.6, 1, 1.3, 1.6, 2, 3), 2, painleve, gains_nothing,
    ),
    Case(
        "rod-on-slope", "A rod falls on a slope: does it come to lie, without gaining energy or sinking?",
        "slope", "of μ", (0.1, 0.25, 0.5, 0.75, 0.9), 0.5, rod_slope, comes_to_lie,
    ),
)  # fmt: skip
