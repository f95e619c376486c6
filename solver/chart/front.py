"""The front: what the best of this solver's methods costs at each error, beside the best peer."""

from dataclasses import dataclass
from typing import Any

from .store import Row

OURS = ("impulse", "exact", "baumgarte", "acceleration")
LEAST_ERROR = 1e-16
"""Less is not told apart: it is rounding, and 0 has no place on a logarithmic axis."""

FASTER = 100.0
NEARER = 1000.0
"""The goal: so many times cheaper at equal error, or so many times more accurate at equal cost."""


@dataclass(frozen=True)
class Point:
    """A run that came out right: its method, error, and ns a simulated second."""

    method: str
    error: float
    ns: float


def points(rows: list[Row], scene: str, ours: bool) -> list[Point]:
    """The runs of a scene that did not fail, cheapest first."""
    some = [
        Point(row["method"], max(row["error"], LEAST_ERROR), row["ns"])
        for row in rows
        if row["scene"] == scene and (row["method"] in OURS) == ours and row["failed"] == ""
    ]
    return sorted(some, key=lambda point: (point.ns, point.error))


def front(some: list[Point]) -> list[Point]:
    """The points that no other beats in both cost and error, cheapest first."""
    best: list[Point] = []
    for point in some:
        if not best or point.error < best[-1].error:
            best.append(point)
    return best


def compare(rows: list[Row], scene: str) -> dict[str, Any] | None:
    """This solver's front against the peers', at each error that any of them reaches.

    Returns:
        cheaper: the least ratio of costs, peer over ours, at equal error (0: ours does not get there);
        nearer: the least ratio of errors at equal cost; met: whether at each of the peers' points ours is
        cheaper, and by the goal in cost or in error; at: the peers' worst point for us. None if no peer
        came out right.
    """
    ours, theirs = front(points(rows, scene, True)), front(points(rows, scene, False))
    if not theirs or not ours:
        return None
    compared = []
    for peer in theirs:
        cost = min((point.ns for point in ours if point.error <= peer.error), default=float("inf"))
        error = min((point.error for point in ours if point.ns <= peer.ns), default=float("inf"))
        compared.append((peer.ns / cost, peer.error / error, peer))
    met = [cheaper >= 1 and (cheaper >= FASTER or nearer >= NEARER) for cheaper, nearer, _peer in compared]
    worst = min(compared, key=lambda c: max(c[0] / FASTER, c[1] / NEARER))
    return {
        "scene": scene,
        "cheaper": min(c[0] for c in compared),
        "cheaper_most": max(c[0] for c in compared),
        "nearer": min(c[1] for c in compared),
        "met": all(met),
        "points_met": sum(met),
        "points": len(met),
        "at": worst[2],
        "at_cheaper": worst[0],
        "at_nearer": worst[1],
        "peers": sorted({peer.method for peer in theirs}),
    }
