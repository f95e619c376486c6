"""Is the task hard enough to need learning, and possible from every start? Simple agents tell."""

from collections.abc import Callable, Iterable

from flipcar_env.starts import MIX

from .assess import AGENTS, SEARCHED, Row, constant_rows, policy_rows, searched
from .evaluate import wilson

RESTING = ("roof", "side", "nose", "upright")
"""Starts at rest, or nearly."""

LIMITS = {
    ("constant", "roof"): "at most 20 %",
    ("constant, best", "roof"): "at most 60 %",
    ("pd", "roof"): "at most 20 %",
    ("random", "roof"): "at most 5 %",
    ("pd", "resting"): "at most 60 %",
}
"""What makes the task hard: so many starts may such an agent recover. A search: at least 99 % of any kind."""


def calibrate(episodes: int = 2000, progress: Callable[[Iterable], Iterable] = iter) -> list[Row]:
    """The share of resting starts on level ground that each agent recovers.

    "resting" is the mixture of the kinds, in the shares that they have in "any".

    Args:
        episodes: of each kind, stratified.
        progress: of the agents.
    """
    rows: list[Row] = []
    for name in progress([*AGENTS, "constant"]):
        if name == "constant":
            found = constant_rows(RESTING, ["level"], episodes)
            rows += _table("constant", {row["start"]: row["success"] for row in found}, episodes)
            rows += _table("constant, best", {row["start"]: row["best"] for row in found}, episodes)[:-1]
        else:
            played = policy_rows(AGENTS[name](), RESTING, ["level"], episodes)
            rows += _table(name, {row["start"]: row["success"] for row in played}, episodes)
    if SEARCHED.exists():
        won = {start: searched(start, "level")[1] < float("inf") for start in RESTING}
        share = {start: float(found.mean()) for start, found in won.items()}
        rows += _table("search", share, len(won["roof"]))
    return rows


def _table(agent: str, share: dict[str, float], episodes: int) -> list[Row]:
    weight = {start: MIX[start] for start in share}
    share = {**share, "resting": sum(weight[s] * share[s] for s in weight) / sum(weight.values())}
    return [
        {
            "agent": agent,
            "start": start,
            "recovered": round(value, 5),
            "wilson_low": round(wilson(round(value * episodes), episodes)[0], 5),
            "episodes": episodes if start != "resting" else "",
            "limit": "at least 99 %" if agent == "search" else LIMITS.get((agent, start), ""),
        }
        for start, value in share.items()
    ]
