"""Few numbers fitted on one half of a data set and judged on the other."""

from collections.abc import Callable, Sequence

import numpy as np

FITTED, JUDGED = slice(0, None, 2), slice(1, None, 2)
"""Every second record is fitted; the others judge."""

RESAMPLES = 2000


def interval(values: np.ndarray) -> tuple[float, float]:
    """95 % confidence interval of the mean of (n,) values: bootstrap, percentiles, the same every time."""
    rng = np.random.default_rng(0)
    means = rng.choice(values, (RESAMPLES, len(values))).mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def described(name: str, values: np.ndarray) -> dict[str, float]:
    """Mean, standard deviation and the mean's 95 % interval of (n,) values, as columns of a table."""
    low, high = interval(values)
    return {
        f"{name}_mean": float(values.mean()),
        f"{name}_sd": float(values.std()),
        f"{name}_low": low,
        f"{name}_high": high,
    }


def fitted(
    cost: Callable[[np.ndarray], float], start: Sequence[float], steps: Sequence[float], evaluations: int
) -> np.ndarray:
    """Where `cost` is least, by Nelder and Mead's simplex: what a bouncing cube makes of it has no slope.

    Args:
        cost: of (k,) numbers >= 0; it is not asked for others.
        start: (k,) first guess.
        steps: (k,) edges of the first simplex.
        evaluations: of `cost`, at most about.
    """
    from scipy.optimize import minimize

    first, edges = np.array(start, float), np.array(steps, float)

    def bounded(z: np.ndarray) -> float:
        x = first + z * edges
        return cost(x) if (x >= 0.0).all() else np.inf

    k = len(first)
    simplex = np.vstack([np.zeros(k), np.eye(k)])
    options = {"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-4}
    return first + edges * minimize(bounded, np.zeros(k), method="Nelder-Mead", options=options).x
