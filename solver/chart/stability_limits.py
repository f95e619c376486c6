"""Limits of the stability map that are known beforehand: where a method must begin to fail, by a formula.

Derived from the growth rates in the docstrings of `solver.chart.naive`.
"""

from collections.abc import Callable

import numpy as np

from solver.chart.stability_case import Case, g, whole
from solver.chart.stability_naive import BETA
from solver.chart.stability_several import BASE, DIP, HALF_ROD, LEAN
from solver.chart.stability_single import BULLET, TOP_TILT, TOP_l, precession

STEP, H = "dt", 1 / 240
"""What a step's limit is filed under; and the step, s, where the scene's parameter is varied."""


def slender(h: float, ratio: float) -> tuple[float, float, float]:
    """Of the slender spin (J₁ = 1, w = (1, 0, 3)): E, its transverse part, and Ω² h T."""
    return 0.5 * (1.0 + 9.0 / ratio), 0.5, (3.0 * (1.0 - 1.0 / ratio)) ** 2 * h * 10.0


def explicit_gain(h: float, ratio: float) -> float:
    """E_t (exp(Ω² h T) − 1)/E."""
    E, across, growth = slender(h, ratio)
    return across * np.expm1(growth) / E


def implicit_loss(h: float, ratio: float) -> float:
    """E_t (1 − exp(−Ω² h T))/E."""
    E, across, growth = slender(h, ratio)
    return -across * np.expm1(-growth) / E


def lengthened(h: float, ratio: float) -> float:
    """(1 + (|w| h/2)²)^(T/2h) − 1."""
    return (1.0 + 10.0 * (h / 2.0) ** 2) ** (5.0 / h) - 1.0


def reached(gain: Callable[[float], float], low: float, high: float, at: float = 0.1) -> float | None:
    """Where a growing function passes 10 %, by bisection; None if it does not in between."""
    if gain(low) > at or gain(high) < at:
        return None
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if gain(middle) < at else (low, middle)
    return float(low)


def drift(s: float) -> float:
    """½ l Ω s sin²θ T: the gap of the top on an unstabilised tip over the step, m/s, after 4 s."""
    return 0.5 * TOP_l * precession(s) * s * np.sin(TOP_TILT) ** 2 * 4.0


def drop_jacobi(slenderness: float) -> float:
    """The rebound over the drop, e² with e = 4/(mG) − 1."""
    a, b = BASE
    c = a * slenderness
    mG = 1.0 + 3.0 * b**2 / (b**2 + c**2) + 3.0 * a**2 / (a**2 + c**2)
    return max(0.0, 4.0 / mG - 1.0) ** 2


JACOBI = reached(drop_jacobi, 1.0, 20.0, 0.01)
PAINLEVE = float((np.tan(LEAN) ** 2 + 4.0) / (3.0 * np.tan(LEAN)))


def limit(method: str, case: Case, varied: str) -> float | None:
    """The value of the step (s) or of the scene's parameter at which a method begins to fail, if known.

    Args:
        method: its name.
        case: the scene.
        varied: "dt" or the parameter.
    """
    x = case.nominal
    known: dict[tuple[str, str], tuple[float | None, float | None]] = {
        ("explicit spin", "slender-spin"): (
            reached(lambda h: explicit_gain(h, x), 1e-6, 1.0),
            reached(lambda r: explicit_gain(H, r), 1.1, 1e3),
        ),
        ("implicit spin", "slender-spin"): (
            reached(lambda h: implicit_loss(h, x), 1e-6, 1.0),
            reached(lambda r: implicit_loss(H, r), 1.1, 1e3),
        ),
        ("quaternion Euler", "slender-spin"): (reached(lambda h: lengthened(h, x), 1e-6, 1.0), None),
        # the energy grows by ½ g² h a second, and by half of that; its tenth is g/10 for a drop of 1 m
        ("Newton's e every step", "lossless-bounce"): (0.2 / (g * x), 0.2 / (g * H)),
        ("popped-out positions", "lossless-bounce"): (0.4 / (g * x), 0.4 / (g * H)),
        # it bounces for ever with e g h/(1 − e): 1 cm/s
        ("Newton's e every step", "settling-ball"): (0.01 * (1.0 - x) / (x * g), 0.01 / (0.01 + g * H)),
        ("no stabilisation", "top"): (1e-3 / drift(x), None),
        # found up to v h deep, and then g h² deeper each step
        ("tests at step ends", "bullet"): (BULLET / (x + g * whole(0.5)), BULLET / H - g * whole(0.5)),
        ("tests at step ends", "dip"): (
            float(np.arccos(1.0 - DIP / HALF_ROD)) / x,
            float(np.arccos(1.0 - DIP / HALF_ROD)) / H,
        ),
        # from the depth φ with β φ/h, so up to φ above the ground if h > β √(φ/4g): from below
        ("Baumgarte β φ/h", "overlap"): (BETA * np.sqrt(1e-3 * x / (4.0 * g)), 4e3 * g * (H / BETA) ** 2),
        ("all contacts at once", "flat-landing"): (None, JACOBI),
        ("acceleration", "flat-landing"): (None, JACOBI),
        ("baumgarte", "flat-landing"): (None, JACOBI),
        # with the v_s that settles in a step it creeps at g sinθ h: a millimetre in 10 s
        ("regularised friction", "slope"): (1e-4 / (g * np.sin(np.arctan(0.5 * x))), None),
        ("f = -l/G, friction", "painleve-rod"): (None, PAINLEVE),
        ("acceleration", "painleve-rod"): (None, PAINLEVE),
        ("baumgarte", "painleve-rod"): (None, PAINLEVE),
        # βh = 2 √(1 − αh) with α = β = 20/s
        ("baumgarte", "top"): (2.0 * (np.sqrt(2.0) - 1.0) / 20.0, None),
    }
    by_step, by_parameter = known.get((method, case.name), (None, None))
    return by_step if varied == STEP else by_parameter
