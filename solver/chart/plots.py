"""Figures of the work-precision study, drawn from its rows alone."""

from pathlib import Path

import numpy as np

from .front import LEAST_ERROR, OURS, Point, front, points
from .store import Row

COLOURS = {
    "impulse": "#1769c2",
    "exact": "#0b2a57",
    "baumgarte": "#7fa8d6",
    "acceleration": "#9fb4c9",
    "MuJoCo Euler": "#d9480f",
    "MuJoCo implicitfast": "#f08c46",
    "MuJoCo RK4": "#a61e4d",
    "PyBullet": "#2b8a3e",
    "Rapier": "#b08900",
    "Drake": "#7048a8",
}
OTHER = "#666666"
PEERS = "#c2410c"
GRID = {"color": "#e3e3e3", "linewidth": 0.6}


def save(figure, path: Path, dpi: int = 110) -> list[Path]:
    """As SVG and as PNG, the same bytes each time; returns both paths."""
    plt = style()
    files = [path.with_suffix(suffix) for suffix in (".svg", ".png")]
    figure.savefig(files[0], metadata={"Date": None})
    figure.set_layout_engine("none")  # laid out once is enough
    figure.savefig(files[1], dpi=dpi)
    plt.close(figure)
    return files


def style():
    """Matplotlib, set for all figures: light, without a screen, the same bytes each time."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update(
        {
            "font.size": 9,
            "svg.hashsalt": "flipcar",
            "svg.fonttype": "none",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "figure.facecolor": "white",
        }
    )
    import matplotlib.pyplot as plt

    return plt


def apart(heights: list[float], gap: float, low: float, high: float) -> list[float]:
    """The heights moved until neighbours are at least so far apart, their order kept, within the limits."""
    order = np.argsort(heights)
    moved = np.array(heights, dtype=float)[order]
    for _ in range(500):
        moved = np.clip(moved, low, high)
        for n in np.flatnonzero(np.diff(moved) < gap):
            push = (gap - (moved[n + 1] - moved[n])) / 2 + 1e-9
            moved[n] -= push
            moved[n + 1] += push
    back = np.empty_like(moved)
    back[order] = moved
    return list(back)


def precision(rows: list[Row], scene: str, title: str, asks: str, path: Path) -> None:
    """One scene: each method's error against its cost, by its step or tolerance; × where it fails."""
    plt = style()
    figure, axes = plt.subplots(figsize=(8.2, 4.6), layout="constrained")
    axes.set(xscale="log", yscale="log", xlabel="wall time of a simulated second, ns", ylabel="error")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    axes.set_title(f"error: {asks}", loc="left", fontsize=8, color="#555555")
    axes.grid(True, **GRID)
    ends = []
    for method in dict.fromkeys(row["method"] for row in rows if row["scene"] == scene):
        curve = [row for row in rows if row["scene"] == scene and row["method"] == method]
        right = [row for row in curve if row["failed"] == ""]
        failed = [row for row in curve if row["failed"] and isinstance(row["error"], float)]
        colour = COLOURS.get(method, OTHER)
        mine = method in OURS
        ns = [row["ns"] for row in right]
        errors = [max(row["error"], LEAST_ERROR) for row in right]
        axes.plot(
            ns, errors, "o-", color=colour, markersize=3.5 if mine else 2.5, linewidth=1.8 if mine else 1.1
        )
        if failed:
            # the finest step that fails: there the curve is cut
            last = min(failed, key=lambda row: row["value"])
            axes.plot(last["ns"], min(last["error"], 30.0), "x", color=colour, markersize=6)
        if right:
            ends.append((method, ns[-1], errors[-1], colour, mine))
    if ends:
        low, high = np.log10(axes.get_ylim())
        wide = axes.get_xlim()
        axes.set_xlim(wide[0], wide[1] * (wide[1] / wide[0]) ** 0.22)
        right = wide[1] * (wide[1] / wide[0]) ** 0.02
        heights = apart([np.log10(end[2]) for end in ends], 0.052 * (high - low), low, high)
        for (method, x, y, colour, mine), height in zip(ends, heights, strict=True):
            axes.annotate(
                method,
                (x, y),
                xytext=(right, 10**height),
                va="center",
                color=colour,
                fontweight="bold" if mine else "normal",
                fontsize=8.5,
                arrowprops={"arrowstyle": "-", "color": colour, "alpha": 0.35, "linewidth": 0.7},
            )
    save(figure, path)


def _steps(some: list[Point], right: float) -> tuple[list[float], list[float]]:
    """A front as a staircase: at each cost the least error, on to the right edge."""
    xs, ys = [], []
    for n, point in enumerate(some):
        if n:
            xs.append(point.ns)
            ys.append(some[n - 1].error)
        xs.append(point.ns)
        ys.append(point.error)
    return [*xs, right], [*ys, some[-1].error]


def fronts(rows: list[Row], titles: dict[str, str], path: Path) -> None:
    """All scenes: the best of ours and the best of the peers, a panel each."""
    plt = style()
    scenes = [scene for scene in titles if any(row["scene"] == scene for row in rows)]
    columns = min(3, len(scenes))
    lines = -(-len(scenes) // columns)
    figure, grid = plt.subplots(
        lines, columns, figsize=(3.3 * columns, 2.35 * lines + 0.5), layout="constrained", squeeze=False
    )
    for axes in grid.flat[len(scenes) :]:
        axes.set_visible(False)
    some = [row for row in rows if row["failed"] == ""]
    left, right = min(row["ns"] for row in some) / 2, max(row["ns"] for row in some) * 2
    for axes, scene in zip(grid.flat, scenes, strict=False):
        axes.set(xscale="log", yscale="log", xlim=(left, right), ylim=(LEAST_ERROR / 3, 50))
        axes.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1])
        axes.minorticks_off()
        axes.grid(True, **GRID)
        axes.set_title(titles[scene], loc="left", fontsize=8.5)
        for mine, colour, name in ((True, COLOURS["impulse"], "FlipCar"), (False, PEERS, "other engines")):
            best = front(points(rows, scene, mine))
            if not best:
                if not mine:
                    axes.text(0.97, 0.9, "no peer gets it right", transform=axes.transAxes, ha="right",
                              color=PEERS, fontsize=7.5)  # fmt: skip
                continue
            xs, ys = _steps(best, right)
            axes.plot(xs, ys, color=colour, linewidth=1.6)
            axes.plot([p.ns for p in best], [p.error for p in best], "o", color=colour, markersize=3)
            # ours goes lowest, the others' begins highest: there nothing is in the way
            x, y, offset, side = (
                (right, best[-1].error, (-2, 4 if best[-1].error < 1e-13 else -10), "right")
                if mine
                else (best[0].ns, best[0].error, (3, 4), "left")
            )
            axes.annotate(
                name, (x, y), xytext=offset, textcoords="offset points", ha=side, color=colour, fontsize=7.5
            )
    figure.supxlabel("wall time of a simulated second, ns", fontsize=9)
    figure.supylabel("error", fontsize=9)
    save(figure, path)
