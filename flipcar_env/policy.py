"""A trained policy, run with numpy and numba alone."""

from collections.abc import Mapping
from importlib.resources import files
from math import tanh
from pathlib import Path

import numpy as np

from solver.algebra import borrowed, entry, keep_alive
from solver.lanes import column, set_column
from solver.trace import LANES, filled

from . import observe

FORMAT = 1
_SHIPPED = files("flipcar_env") / "policies"


ABREAST = 4
"""Outputs worked out side by side, so that none waits for its own last addition; layers are padded to it."""


@entry
def _forward(weights, sizes, squash, obs, actions):
    """Tanh layers, then a linear one, clipped or squashed to [-1, 1]; each row's sums in the same order.

    (A BLAS product gives other bits for one row than for many.) Rows share the processor's lanes.

    Args:
        weights: of each layer (outputs / 4, inputs, 4), then biases; outputs are padded with noughts.
        sizes: of the observation and of each layer, padded.
        squash: take the last layer's tanh, too.
        obs: (n, k) float32.
        actions: (n, 3) float32, filled.
    """
    first, second = np.empty((sizes.max(), LANES)), np.empty((sizes.max(), LANES))
    before, after = borrowed(first), borrowed(second)
    for row in range(0, obs.shape[0], LANES):
        used = min(LANES, obs.shape[0] - row)
        for j in range(obs.shape[1]):
            for lane in range(LANES):
                before[j, lane] = obs[row + min(lane, used - 1), j]
        at = 0
        for layer in range(len(sizes) - 1):
            n_in, n_out = sizes[layer], sizes[layer + 1]
            biases = at + n_in * n_out
            for k in range(0, n_out, ABREAST):
                x = column(before, 0)
                a, b = filled(x, weights[biases + k]), filled(x, weights[biases + k + 1])
                c, d = filled(x, weights[biases + k + 2]), filled(x, weights[biases + k + 3])
                for j in range(n_in):
                    x = column(before, j)
                    a = a + weights[at] * x
                    b = b + weights[at + 1] * x
                    c = c + weights[at + 2] * x
                    d = d + weights[at + 3] * x
                    at += ABREAST
                set_column(after, k, a)
                set_column(after, k + 1, b)
                set_column(after, k + 2, c)
                set_column(after, k + 3, d)
            at = biases + n_out
            for k in range(n_out):
                for lane in range(used):
                    if squash or layer < len(sizes) - 2:
                        after[k, lane] = tanh(after[k, lane])
                    else:
                        after[k, lane] = min(1.0, max(-1.0, after[k, lane]))
            before, after = after, before
        for lane in range(used):
            for k in range(3):
                actions[row + lane, k] = before[k, lane]
    keep_alive(first, second)


def _packed(layers: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """(weights, sizes) as `_forward` takes them."""
    sizes, parts = [layers[0][0].shape[1]], []
    for weight, bias in layers:
        n_out = -(-len(bias) // ABREAST) * ABREAST
        padded = np.zeros((n_out, sizes[-1]))
        padded[: len(bias), : weight.shape[1]] = weight
        parts.append(padded.reshape(-1, ABREAST, sizes[-1]).transpose(0, 2, 1).ravel())
        parts.append(np.pad(np.asarray(bias, dtype=np.float64), (0, n_out - len(bias))))
        sizes.append(n_out)
    return np.concatenate(parts), np.array(sizes)


class Policy:
    """A multilayer perceptron from observations to actions; observation scaling is folded in.

    Args:
        layers: (weight (out, in), bias (out,)) of each layer; tanh between them.
        obs: kind of observation it was trained on.
        squash: take the last layer's tanh, too, instead of clipping it.

    Raises:
        ValueError: the layers do not fit one another, the observation or the action.
    """

    def __init__(self, layers: list[tuple[np.ndarray, np.ndarray]], obs: str, squash: bool = False):
        self.obs, self._squash = obs, squash
        k = observe.space(obs).shape[0]
        sizes = [k]
        for i, (weight, bias) in enumerate(layers):
            if weight.ndim != 2 or weight.shape[1] != sizes[-1] or bias.shape != weight.shape[:1]:
                raise ValueError(
                    f"layer {i} must have a weight (n, {sizes[-1]}) and a bias (n,), "
                    f"got {weight.shape} and {bias.shape}"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {i} must be finite")
            sizes.append(len(bias))
        if len(sizes) < 2 or sizes[-1] != 3:
            raise ValueError(f"the last layer must have 3 outputs, got sizes {sizes}")
        self._weights, self._sizes = _packed(layers)

    def __call__(self, obs: np.ndarray) -> np.ndarray:
        """Actions of observations: (k,) to (3,), or (n, k) to (n, 3), float32.

        A row's action has the same bits alone and in any batch.

        Raises:
            ValueError: wrong shape.
        """
        obs = np.asarray(obs, dtype=np.float32)
        if obs.ndim not in (1, 2) or obs.shape[-1] != self._sizes[0]:
            k = self._sizes[0]
            raise ValueError(f"obs must have shape ({k},) or (n, {k}), got {obs.shape}")
        batch = np.ascontiguousarray(np.atleast_2d(obs))
        actions = np.empty((len(batch), 3), dtype=np.float32)
        _forward(self._weights, self._sizes, self._squash, batch, actions)
        return actions if obs.ndim == 2 else actions[0]


def save_policy(
    path: str | Path, layers: list[tuple[np.ndarray, np.ndarray]], obs: str, squash: bool = False
) -> None:
    """Write a policy file (.npz, no pickle)."""
    arrays = {"format": np.array(FORMAT), "obs": np.array(obs), "squash": np.array(squash)}
    for i, (weight, bias) in enumerate(layers):
        arrays[f"weight{i}"] = np.asarray(weight, dtype=np.float64)
        arrays[f"bias{i}"] = np.asarray(bias, dtype=np.float64)
    np.savez(path, allow_pickle=False, **arrays)


def shipped() -> list[str]:
    """Names of the policies that come with the package."""
    return sorted(Path(str(p)).stem for p in _SHIPPED.iterdir() if p.name.endswith(".npz"))


def load_policy(name: str | Path) -> Policy:
    """A shipped policy by its name, or one from a file.

    Raises:
        ValueError: no such policy, or the file is not one.
    """
    source = Path(name)
    if str(name) in shipped():
        source = Path(str(_SHIPPED / f"{name}.npz"))
    elif not source.is_file():
        raise ValueError(
            f"policy must be one of {', '.join(map(repr, shipped()))} or a file, got {str(name)!r}"
        )
    try:
        with np.load(source, allow_pickle=False) as data:
            arrays: Mapping[str, np.ndarray] = dict(data)
        if int(arrays["format"]) != FORMAT:
            raise ValueError(f"format {int(arrays['format'])} is not {FORMAT}")
        n = sum(key.startswith("weight") for key in arrays)
        layers = [(arrays[f"weight{i}"], arrays[f"bias{i}"]) for i in range(n)]
        return Policy(layers, str(arrays["obs"]), bool(arrays.get("squash", False)))
    except Exception as error:  # numpy raises many kinds for a file that is not what it says
        raise ValueError(f"policy file {str(source)!r} can't be read: {error}") from error
