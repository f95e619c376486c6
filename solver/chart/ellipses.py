"""Measured impacts of an ellipse in the plane (Fazeli et al.): the velocities after, from those before.

Error of an impact: |u − u_measured| / |u_measured| of the velocities after, in the norm whose square is
twice the kinetic energy, in %. So measured, one μ = .18 and e = .55 for all give 18.3 %, and the best
impulse at the contact point, fitted to each impact's outcome, 7.1 %.

An impact here is the solver's own: the path of Eq. 12 with energetic restitution.

The file's Jacobians are those of the attitude one frame before; `Impacts.fresh` has those of the attitude
given. `python -m solver.chart.ellipses FILE` fits the numbers of `MODEL` again, on every second impact.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from solver.algebra import entry
from solver.exact.impact import impact

from .fitting import FITTED, JUDGED, described, fitted

CENTRE = 0.373
"""m: the middle of the places where the ellipses of the file come down."""


@dataclass(frozen=True)
class Model:
    """What an impact is made of; each field but the first two is a term.

    Attributes:
        friction: μ.
        restitution: e, energetic, at the middle of the board.
        tilt: of the board's normal against the camera's vertical, rad.
        place: what e loses per metre along the board.
        inertia: the moment of inertia, as a multiple of the solid ellipse's.
        fresh: is the contact point that of the attitude given?
    """

    friction: float
    restitution: float
    tilt: float = 0.0
    place: float = 0.0
    inertia: float = 1.0
    fresh: bool = False


FREE = {"friction": 0.02, "restitution": 0.03, "tilt": 0.01, "place": 0.1, "inertia": 0.05}
"""The numbers that are fitted, and a first step of each."""

MODEL = Model(0.1752, 0.5387, tilt=0.02726, place=0.9891, inertia=0.7548, fresh=True)
"""Fitted on every second impact of the file, 584 of them, by `python -m solver.chart.ellipses FILE`."""

PLAIN = Model(0.18, 0.55)
"""One μ and one e for all: what the literature compares with."""


@dataclass(frozen=True)
class Impacts:
    """The data set, n impacts; velocities are (vx, vy, ω).

    Attributes:
        x: (n,) m, where along the board.
        theta: (n,) rad, attitude before.
        before: (n, 3) m/s, rad/s.
        after: (n, 3).
        jac_n: (n, 3) times a velocity: the contact point's along the normal.
        jac_t: (n, 3) and along the board.
        inertia: (3,) m, m, J of the solid ellipse.
        semi_axes: (2,) m.
    """

    x: np.ndarray
    theta: np.ndarray
    before: np.ndarray
    after: np.ndarray
    jac_n: np.ndarray
    jac_t: np.ndarray
    inertia: np.ndarray
    semi_axes: np.ndarray

    def some(self, which: slice) -> "Impacts":
        """These impacts alone."""
        whole = ("inertia", "semi_axes")
        parts = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name not in whole}
        return replace(self, **parts)

    def fresh(self) -> "Impacts":
        """The same with the Jacobians of `theta`."""
        a, b = self.semi_axes
        s, c = np.sin(self.theta), np.cos(self.theta)
        height = np.hypot(a * s, b * c)
        zero, one = np.zeros_like(height), np.ones_like(height)
        jac_n = np.column_stack([zero, one, (b**2 - a**2) * s * c / height])
        return replace(self, jac_n=jac_n, jac_t=np.column_stack([one, zero, -height]))

    def norm(self, u: np.ndarray) -> np.ndarray:
        """The root of twice the kinetic energy of velocities (n, 3), √J: (n,)."""
        return np.sqrt((u**2 * self.inertia).sum(axis=1))

    def error(self, u: np.ndarray) -> np.ndarray:
        """(n,) the error of velocities after, %."""
        return 100.0 * self.norm(u - self.after) / self.norm(self.after)


def load(path: str | Path) -> Impacts:
    """Read a file of impacts (.npz).

    Raises:
        ValueError: there is no such file, or it is not one of impacts.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"data must be a file of impacts (.npz), got {str(path)!r}")
    try:
        with np.load(path, allow_pickle=False) as data:
            pre, post = data["pre"].astype(float), data["post"].astype(float)
            jac_n, jac_t = data["jac_n"].astype(float), data["jac_t"].astype(float)
            m, semi_axes = float(data["mass"]), data["semi_axes"].astype(float)
        parts = {"pre": (pre, 6), "post": (post, 6), "jac_n": (jac_n, 3), "jac_t": (jac_t, 3)}
        for name, (array, columns) in parts.items():
            if array.shape != (len(pre), columns) or not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite and have shape (n, {columns}), got {array.shape}")
    except (KeyError, OSError, ValueError) as error:
        raise ValueError(f"data {str(path)!r} is not a file of impacts: {error}") from error
    inertia = np.array([m, m, 0.25 * m * (semi_axes**2).sum()])
    return Impacts(pre[:, 0], pre[:, 2], pre[:, 3:], post[:, 3:], jac_n, jac_t, inertia, semi_axes)


@entry
def impulses(K, mu, e, u):
    """Eq. 12 in a plane, for each row: (n, 2) p_n and p_t, N s.

    Args:
        K: (n, 3) nn, nt, tt (Eq. 10), 1/kg. Nothing moves along the second tangent.
        mu: friction coefficient.
        e: (n,) energetic restitution.
        u: (n, 2) velocity of the contact point along the normal and the board, m/s.
    """
    p = np.zeros((len(u), 2))
    for k in range(len(u)):
        row = (K[k, 0], K[k, 1], 0.0, K[k, 2], 0.0, K[k, 0])
        p_n, p_t, _zero, _ok = impact(row, mu, e[k], (u[k, 0], u[k, 1], 0.0))
        p[k, 0], p[k, 1] = p_n, p_t
    return p


def frame(data: Impacts, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """The Jacobians of a board whose normal is turned by so many rad towards −x. The contact point stays."""
    c, s = np.cos(tilt), np.sin(tilt)
    return c * data.jac_n - s * data.jac_t, c * data.jac_t + s * data.jac_n


def predicted(data: Impacts, model: Model) -> np.ndarray:
    """(n, 3): the velocities after."""
    data = data.fresh() if model.fresh else data
    N, t = frame(data, model.tilt)
    inertia = data.inertia * (1.0, 1.0, model.inertia)
    K = np.column_stack([(N * N / inertia).sum(1), (N * t / inertia).sum(1), (t * t / inertia).sum(1)])
    u = np.column_stack([(N * data.before).sum(1), (t * data.before).sum(1)])
    e = np.clip(model.restitution - model.place * (data.x - CENTRE), 0.0, 1.0)
    p = impulses(K, model.friction, e, u)
    return data.before + (N * p[:, :1] + t * p[:, 1:]) / inertia


def best_impulse(data: Impacts) -> tuple[np.ndarray, np.ndarray]:
    """The impulse (n, 2) at the contact point that is nearest to each outcome, and (n, 3) what it gives."""
    root = np.sqrt(data.inertia)
    W = np.stack([data.jac_n, data.jac_t], axis=2) / root[:, None]
    p = np.linalg.pinv(W) @ ((data.after - data.before) * root)[..., None]
    return p[..., 0], data.before + (W @ p)[..., 0] / root


WIDTH, NOISE = 2.0, 0.1
"""Of the smooth function: its length, in standard deviations of what it depends on; its ridge. Both near
the best on the impacts that judge it, so it flatters itself."""


def smooth(data: Impacts) -> np.ndarray:
    """(n, 3): an impulse that is any smooth function of place, attitude and velocities before.

    By kernel ridge regression on the half that is fitted: what no law of contact, however many terms it
    has, will do much better than from the same state.
    """
    N, t = frame(data, 0.0)
    u_n, u_t = (N * data.before).sum(1), (t * data.before).sum(1)
    state = np.column_stack(
        [np.sin(2 * data.theta), np.cos(2 * data.theta), u_t / u_n, data.before[:, 2], u_n, data.x]
    )
    state = (state - state.mean(axis=0)) / state.std(axis=0) / WIDTH
    kernel = np.exp(-0.5 * ((state[:, None] - state[None]) ** 2).sum(axis=2))
    target = best_impulse(data)[0] / u_n[:, None]
    here, mean = target[FITTED], target[FITTED].mean(axis=0)
    ridge = kernel[FITTED, FITTED] + NOISE * np.eye(len(here))
    p = u_n[:, None] * (mean + kernel[:, FITTED] @ np.linalg.solve(ridge, here - mean))
    return data.before + (N * p[:, :1] + t * p[:, 1:]) / data.inertia


TERMS: dict[str, dict[str, Any]] = {
    "friction": {"friction": 0.0},
    "restitution": {"restitution": 0.0, "place": 0.0},
    "tilt": {"tilt": 0.0},
    "place": {"place": 0.0},
    "inertia": {"inertia": 1.0},
    "fresh contact point": {"fresh": False},
}
"""What can be left out, and what a model then is."""


def fit(data: Impacts, model: Model, without: str | None = None, evaluations: int = 300) -> Model:
    """`model` with its numbers, but for a term left out, fitted to the impacts given: least mean error."""
    left_out = TERMS[without] if without else {}
    names = [name for name in FREE if name not in left_out]
    model = replace(model, **left_out)

    def made(numbers: np.ndarray) -> Model:
        values: dict[str, Any] = dict(zip(names, map(float, numbers), strict=True))
        return replace(model, **values)

    def cost(numbers: np.ndarray) -> float:
        return float(data.error(predicted(data, made(numbers))).mean())

    guess = [getattr(model, name) for name in names]
    return made(fitted(cost, guess, [FREE[name] for name in names], evaluations))


def row(error: np.ndarray, terms: str, on: tuple[str, str], model: Model | None = None) -> dict:
    """A line of the study."""
    numbers = ", ".join(f"{name} {getattr(model, name):.4g}" for name in FREE) if model else ""
    return {
        "data": "ellipse impacts", "model": "recorded", "terms": terms, "parameters": numbers,
        "fitted_on": on[0], "judged_on": on[1], "n": len(error), **described("error", error),
    }  # fmt: skip


def study(path: str | Path, quick: bool = False) -> list[dict]:
    """Every line of the comparison with measured impacts; `quick`: on 100 of them, with no fit but one.

    The other numbers are fitted again without each term. Crossed: fitted on either half, judged on the other.
    """
    data = load(path)
    if quick:
        data = data.some(slice(0, 100))
    half, rest = data.some(FITTED), data.some(JUDGED)
    split = ("every second impact", "the others")
    rows = [
        row(data.error(predicted(data, PLAIN)), "one μ, one e", ("literature", "all"), PLAIN),
        row(data.error(best_impulse(data)[1]), "best point impulse", ("each impact itself", "all")),
        row(data.error(smooth(data))[JUDGED], "any smooth function", split),
        row(rest.error(predicted(rest, MODEL)), "all", split, MODEL),
    ]
    other = fit(rest, MODEL, evaluations=20 if quick else 300)
    crossed = np.concatenate([rest.error(predicted(rest, MODEL)), half.error(predicted(half, other))])
    rows.append(row(crossed, "all", ("either half", "the other")))
    for term in TERMS:
        model = replace(MODEL, **TERMS[term])
        model = model if quick else fit(half, model, term)
        rows.append(row(rest.error(predicted(rest, model)), f"without {term}", split, model))
    return rows


def main() -> None:
    """Fit the model on every second impact and print it with its error on the others."""
    import sys

    if len(sys.argv) != 2:
        sys.exit("usage: python -m solver.chart.ellipses FILE")
    data = load(sys.argv[1])
    found, rest = fit(data.some(FITTED), MODEL), data.some(JUDGED)
    print(found, rest.error(predicted(rest, found)).mean())


if __name__ == "__main__":
    main()
