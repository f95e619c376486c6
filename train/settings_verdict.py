"""What the rows of `train.settings` say: which setting is chosen, and what it costs."""

from math import hypot, inf
from typing import Any

from .settings import DEFAULT, FINER, NOTICED, Row

Rows = list[Row]


def pick(rows: Rows, quantity: str, **where: Any) -> Rows:
    """The rows of a quantity in which these columns have these values, by increasing steps."""
    where["quantity"] = quantity
    found = [row for row in rows if all(row[name] == value for name, value in where.items())]
    return sorted(found, key=lambda row: row["substeps"])


def noticed(rows: Rows, substeps: int) -> float:
    """The rare change of the policy's action by a setting, at the worse horizon; inf if it ever failed."""
    errors = pick(rows, "error", method="impulse", substeps=substeps)
    return max(inf if row["failed"] else row["action_rare"] for row in errors)


def tried(rows: Rows) -> list[int]:
    """Physics steps in a control step of which the error was measured."""
    return sorted({int(row["substeps"]) for row in pick(rows, "error", method="impulse")})


def cheapest(rows: Rows) -> int | None:
    """Fewest physics steps in a control step of which a policy notices nothing; None if it always does."""
    return min((n for n in tried(rows) if noticed(rows, n) < NOTICED), default=None)


def differences(rows: Rows, substeps: int) -> dict[str, tuple[float, float, float]]:
    """Success at a setting less that at one `FINER` times finer, for each start tried at both.

    Returns:
        start: (difference, its 95 % interval), Newcombe's from two of Wilson's (Stat. Med. 17:873, 1998,
        method 10). The two agree if the interval holds 0.
    """
    found = {}
    for row in pick(rows, "success", substeps=substeps):
        for fine in pick(rows, "success", substeps=FINER * substeps, start=row["start"]):
            p, low, high = (row[name] for name in ("success", "low", "high"))
            p2, low2, high2 = (fine[name] for name in ("success", "low", "high"))
            d = p - p2
            found[row["start"]] = d, d - hypot(p - low, high2 - p2), d + hypot(high - p, p2 - low2)
    return found


def verdict(rows: Rows) -> str:
    """Three lines: the cheapest setting of which a policy notices nothing, its success, its cost."""
    n = cheapest(rows)
    if n is None:
        return f"No setting tried keeps the change of the policy's action below {NOTICED:g} of full torque."
    return "\n".join([_step(rows, n), _success(rows, n), _cost(rows, n)])


def _step(rows: Rows, n: int) -> str:
    coarser = [k for k in tried(rows) if k < n]
    beside = f", with {coarser[-1]} by {noticed(rows, coarser[-1]):.2g}" if coarser else ""
    kind = "the default" if n == DEFAULT else f"not the default {DEFAULT}"
    return (
        f'Step: "impulse" with {n} steps in each 0.04 s, {kind}, is the cheapest setting that no policy '
        f"notices. In all but one of the 250 control steps of the longest episode its error, of one control "
        f"step or of half a second, changes the next action by less than {NOTICED:g} of full torque: "
        f"with {n} by {noticed(rows, n):.2g}{beside}."
    )


def _success(rows: Rows, n: int) -> str:
    compared = differences(rows, n)
    if not compared:
        return f"Success: not measured both with {n} and with {FINER * n} steps."
    apart = [start for start, (_d, low, high) in compared.items() if not low <= 0.0 <= high]
    agree = f"differ from start {', '.join(apart)}" if apart else "agree within the 95 % interval"
    shares = {
        k: [row["success"] for row in pick(rows, "success", substeps=k) if row["start"] in compared]
        for k in (n, FINER * n)
    }
    means = [f"{sum(p) / len(p):.2%} (worst kind {min(p):.2%})" for p in shares.values()]
    cars = int(pick(rows, "success", substeps=n)[0]["n"])
    return (
        f"Success: with {n} and with {FINER * n} steps the shipped policy recovers {means[0]} and {means[1]} "
        f"of {cars} cars from each of {len(compared)} kinds of start; they {agree}."
    )


def _cost(rows: Rows, n: int) -> str:
    costs = {int(row["substeps"]): row for row in pick(rows, "cost")}
    text = f"Cost: a control step takes {costs[n]['ns'] / 1e3:.1f} µs"
    for k in (1, FINER * n):
        if k in costs and k != n:
            text += (
                f", with {k} step{'s' * (k > 1)} {costs[k]['ratio'] / costs[n]['ratio']:.2g} times as long"
            )
    kernel = "".join(f" The kernel's terms are {row['note']}." for row in pick(rows, "terms"))
    return f"{text}.{kernel}"
