"""Where recoveries succeed, over the roll and pitch of the start."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .evaluate import Played

ROLLS, PITCHES = np.linspace(-180.0, 180.0, 37), np.linspace(-90.0, 90.0, 19)
"""degrees, the cells' edges."""


def draw(played: Sequence[Played], path: Path, terrain: str) -> None:
    """Draw the share of recoveries in each cell; cells that no start fell into stay empty.

    Args:
        played: episodes, of one terrain.
        path: PNG to write.
        terrain: for the title.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    roll, pitch = (
        np.degrees(np.concatenate([getattr(p, name) for p in played])) for name in ("roll", "pitch")
    )
    won = np.concatenate([p.success for p in played])
    n = np.histogram2d(roll, pitch, [ROLLS, PITCHES])[0]
    share = np.histogram2d(roll, pitch, [ROLLS, PITCHES], weights=won)[0] / np.where(n > 0, n, np.nan)
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    image = axes.pcolormesh(ROLLS, PITCHES, 100.0 * share.T, vmin=0.0, vmax=100.0, cmap="cividis")
    axes.set(
        xlabel="roll of the start, degrees", ylabel="pitch, degrees", xticks=ROLLS[::6], yticks=PITCHES[::3]
    )
    axes.set_title(f"{terrain}: {won.mean():.2%} of {len(won):,} starts recovered")
    figure.colorbar(image, label="recovered, %")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)
