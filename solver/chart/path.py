"""A lone point's frictional impact as the path it is, integrated by SciPy's DOP853: for the reference.

du = K (N − μ s) dp_n,   s = u_t/|u_t|,   stick where the cone allows it              (12)
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from .coulomb import Undetermined

RTOL, ATOL = 1e-13, 1e-15

SAMPLES = 8
"""Of each step, where a sign is looked for."""

PATH_END = 1e-11
"""Of the point's speed before an impact: slip so slow has stopped."""

LONGEST = 1e3
"""Of the impulse that would stop the point without friction."""


def until(
    rate: Callable, t: float, y: np.ndarray, end: float, sign: Callable, first: float | None = None
) -> tuple[float, np.ndarray, str]:
    """Integrate ẏ = rate(y) to `end`, or to where sign(y) is no longer "": (t, y, what it is there).

    It is looked for at SAMPLES places of each step, then by halving. The step is done again up to there,
    as that is more accurate than what interpolates.
    """
    solver = DOP853(lambda t, y: rate(y), t, y, end, rtol=RTOL, atol=ATOL, first_step=first)
    while solver.status == "running":
        start = solver.y
        solver.step()
        if solver.status == "failed":
            raise Undetermined(f"no step is short enough at {solver.t:.9g} s")
        between = solver.dense_output()
        times = np.linspace(solver.t_old, solver.t, SAMPLES + 1)
        high = next((k for k in range(1, SAMPLES + 1) if sign(between(times[k]))), None)
        if high is not None:
            low, high = times[high - 1], times[high]
            while low < (middle := 0.5 * (low + high)) < high:
                low, high = (low, middle) if sign(between(middle)) else (middle, high)
            return high, until(rate, solver.t_old, start, high, lambda y: "")[1], sign(between(high))
    return end, solver.y, ""


def strike(K: np.ndarray, u: np.ndarray, mu: float, e: float) -> np.ndarray:
    """The impulse (3,) of a lone point that closes with u (3,), K (3, 3): Eq. 12, over p_n.

    It ends once restitution has given back e² of the work that compression took (Stronge 1990).

    Raises:
        Undetermined: it jams, or would compress a second time.
    """
    speed = np.linalg.norm(u)
    z = np.append(u, 0.0)  # velocity, and the work of p_n
    taken = None  # by compression, J, once it is over
    way = None  # dp/dp_n, once slip has stopped: from there on it is constant
    what = "slip stops" if np.hypot(*u[1:]) <= PATH_END * speed else ""
    while what != "given back" and not (what == "compressed" and e == 0.0):
        if way is None and what == "slip stops":
            z[1:3] = 0.0
            way = from_rest(K, mu)
            if K[0] @ way <= 0.0:
                raise Undetermined("a point jams")

        def rate(z, way=way):
            against = np.append(1.0, -mu * z[1:3] / np.hypot(*z[1:3])) if way is None else way
            return np.append(K @ against, z[0])

        def sign(z, taken=taken, way=way):
            if way is None and np.hypot(*z[1:3]) <= PATH_END * speed:
                return "slip stops"
            if taken is None:
                return "compressed" if z[0] >= 0.0 else ""
            return "given back" if z[3] >= (1.0 - e * e) * taken else ""

        _p_n, z, what = until(rate, 0.0, z, LONGEST * speed / K[0, 0], sign)
        if what == "":
            raise Undetermined("an impact has no end, or compresses twice")
        if what == "compressed":
            z[0], taken = 0.0, z[3]
    return np.linalg.solve(K, z[:3] - u)


def from_rest(K: np.ndarray, mu: float) -> np.ndarray:
    """dp/dp_n (3,) of a path without slip: it sticks, or slip grows in the direction friction can't hold."""
    sticks = np.append(1.0, -np.linalg.solve(K[1:, 1:], K[1:, 0]))
    if np.hypot(*sticks[1:]) <= mu:
        return sticks

    def growth(angle):
        """(s, along s, across it)."""
        s = np.array([np.cos(angle), np.sin(angle)])
        v = K[1:, 0] - mu * K[1:, 1:] @ s
        return s, v @ s, s[0] * v[1] - s[1] * v[0]

    for a, b in pairwise(np.linspace(-np.pi, np.pi, 361)):
        if growth(a)[2] * growth(b)[2] <= 0.0:
            s, along, _across = growth(brentq(lambda angle: growth(angle)[2], a, b, xtol=1e-15))
            if along > 0.0:
                return np.append(1.0, -mu * s)
    raise Undetermined("slip begins nowhere")
