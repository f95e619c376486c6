"""Where recoveries fail, over the roll and pitch of the start."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .evaluate import Played

SIDE = 10
"""degrees, of a cell."""

ROLLS, PITCHES = np.arange(-180, 181, SIDE), np.arange(-90, 91, SIDE)
"""degrees, the cells' edges."""

SEEN, FEWEST = "#e3e8ec", 0.1
"""The colour of a cell in which no start failed; %, from which on the scale tells."""


def cells(terrain: str, played: Sequence[Played]) -> list[dict[str, Any]]:
    """Of each cell that a start of these episodes fell into: its lower edges, starts, and those recovered."""
    roll, pitch = (
        np.degrees(np.concatenate([getattr(p, name) for p in played])) for name in ("roll", "pitch")
    )
    won = np.concatenate([p.success for p in played])
    n = np.histogram2d(roll, pitch, [ROLLS, PITCHES])[0].astype(int)
    recovered = np.histogram2d(roll, pitch, [ROLLS, PITCHES], weights=won)[0].astype(int)
    return [
        {
            "terrain": terrain,
            "roll": int(ROLLS[i]),
            "pitch": int(PITCHES[j]),
            "starts": int(n[i, j]),
            "recovered": int(recovered[i, j]),
        }
        for i, j in np.argwhere(n)
    ]


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the share of failures in each cell, a panel for each terrain; cells without a start stay empty.

    Args:
        rows: of `cells`, or read back from the CSV in which they are kept.
        path: PNG to write.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm

    terrains = list(dict.fromkeys(row["terrain"] for row in rows))
    columns = min(2, len(terrains))
    lines = -(-len(terrains) // columns)
    shades = LogNorm(FEWEST, 100.0)
    figure, panels = plt.subplots(
        lines, columns, figsize=(1.0 + 4.6 * columns, 0.4 + 2.6 * lines), squeeze=False, layout="constrained",
        sharex=True, sharey=True,
    )  # fmt: skip
    for axes, terrain in zip(panels.flat, terrains, strict=False):
        n, won = np.zeros((2, len(ROLLS) - 1, len(PITCHES) - 1))
        for row in rows:
            if row["terrain"] == terrain:
                at = (int(row["roll"]) + 180) // SIDE, (int(row["pitch"]) + 90) // SIDE
                n[at], won[at] = int(row["starts"]), int(row["recovered"])
        axes.pcolormesh(ROLLS, PITCHES, np.where(n > 0, 1.0, np.nan).T, cmap=ListedColormap([SEEN]))
        failed = 100.0 * (n - won) / np.maximum(n, 1.0)
        failed = np.where(failed > 0, np.maximum(failed, FEWEST), np.nan)
        axes.pcolormesh(ROLLS, PITCHES, failed.T, norm=shades, cmap="cividis_r")
        axes.set(xticks=ROLLS[::6], yticks=PITCHES[::3], facecolor="white")
        axes.set_title(f"{terrain}: {won.sum() / n.sum():.2%} of {int(n.sum()):,} recovered", fontsize=11)
    for axes in panels[-1]:
        axes.set_xlabel("roll of the start, degrees")
    for axes in panels[:, 0]:
        axes.set_ylabel("pitch, degrees")
    bar = figure.colorbar(
        ScalarMappable(shades, "cividis_r"), ax=panels, ticks=[0.1, 1, 10, 100], format="%g"
    )
    bar.set_label("failed, % (grey: none; white: no start)")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)
