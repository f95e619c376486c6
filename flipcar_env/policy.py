"""A trained policy, run with numpy and numba alone."""

from collections.abc import Mapping
from importlib.resources import files
from math import tanh
from pathlib import Path

import numpy as np

from solver.algebra import entry

from . import observe

FORMAT = 1
_SHIPPED = files("flipcar_env") / "policies"


@entry
def _forward(weights, sizes, squash, obs, hidden, actions):
    """Tanh layers, then a linear one, clipped or squashed to [-1, 1]; row by row, so batches keep bits.

    (A BLAS product gives other bits for one row than for many.)
    """
    for i in range(obs.shape[0]):
        for j in range(sizes[0]):
            hidden[0, j] = obs[i, j]
        at = 0
        now = 0
        for layer in range(len(sizes) - 1):
            n_in, n_out = sizes[layer], sizes[layer + 1]
            bias = at + n_in * n_out
            for k in range(n_out):
                s = weights[bias + k]
                for j in range(n_in):
                    s += weights[at + k * n_in + j] * hidden[now, j]
                if squash or layer < len(sizes) - 2:
                    hidden[1 - now, k] = tanh(s)
                else:
                    hidden[1 - now, k] = min(1.0, max(-1.0, s))
            at = bias + n_out
            now = 1 - now
        for k in range(sizes[-1]):
            actions[i, k] = hidden[now, k]


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
        self._sizes = np.array(sizes)
        self._weights = np.concatenate(
            [np.asarray(a, dtype=np.float64).ravel() for layer in layers for a in layer]
        )

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
        hidden = np.empty((2, self._sizes.max()))
        _forward(self._weights, self._sizes, self._squash, batch, hidden, actions)
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
