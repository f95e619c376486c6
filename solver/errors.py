"""What the solver raises, and the checks at its border."""

import numpy as np


class SolverError(RuntimeError):
    """A run that cannot go on.

    Attributes:
        time: s, when it stopped.
        state: the last good `State` (of the one body that failed).
        reason: why.
        index: which body of a batch, else None.
    """

    def __init__(self, reason: str, time: float, state: object, index: int | None = None):
        where = "" if index is None else f" of body {index}"
        super().__init__(f"the run{where} stopped at t = {time:.6g} s: {reason}; state: {state}")
        self.reason = reason
        self.time = time
        self.state = state
        self.index = index


def finite(name: str, value: object, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """`value` as a float64 array.

    Raises:
        ValueError: not numeric, not finite, or not of the shape asked for.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be numbers, got {value!r}") from error
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {value!r}")
    return array


def number(
    name: str, value: object, low: float = -np.inf, high: float = np.inf, above: float = -np.inf
) -> float:
    """`value` as a float within [low, high] and > above.

    Raises:
        ValueError: otherwise, naming what is allowed.
    """
    result = float(finite(name, value, ()))
    if not low <= result <= high or not result > above:
        allowed = f"> {above:g}" if above > -np.inf else f">= {low:g}"
        if high < np.inf:
            allowed += f" and <= {high:g}"
        raise ValueError(f"{name} must be {allowed}, got {result:g}")
    return result


def one_of(name: str, value: object, allowed) -> str:
    """`value` if it is among the names allowed.

    Raises:
        ValueError: otherwise, listing them.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r}")
    return value
