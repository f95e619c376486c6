"""The report: Markdown from the folder's CSV files alone."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from . import front
from .problems import Problem
from .store import MACHINE, Row

LIMITATIONS = """\
- One rigid body on one surface: nothing here says how an engine does with joints, stacks or many bodies,
  which is what the other engines are made for and this solver cannot do.
- The engines' contact models differ. MuJoCo's and Drake's are soft by design, and being soft is not an
  error in itself; here the question is how near each comes to the rigid body with Coulomb friction, at
  what cost. At frictional impacts rigid-body laws differ, too: "exact" follows the path of the impact with
  energetic restitution, "impulse" and the peers solve it at once. Where it matters it bounds their error.
- Times are of shared virtual cores and change by tens of percent; only ratios taken in one run mean
  anything, and only large ones. Every point is a median; its spread is in the CSV.
- MuJoCo steps in its own C loop, this solver in its compiled one. PyBullet, Rapier and Drake are called
  from Python, once a step: about a microsecond of each step is the call's. Rapier counts in single precision.
- MuJoCo has no coefficient of restitution; where one is asked for, its manual's damped contact stands in
  (`bounce`), with Euler and implicitfast. Drake refuses: its point contacts have none either.
- The peers' settings are the best of those tried (`sweep.csv`), by the error at 120 and 960 steps a second;
  someone who knows an engine better may find better ones.
- Errors below 1e-16 are drawn there. The reference for the three scenes without a closed form is
  this project's own "exact" method, checked by an independent integration (`reference.csv`).
"""


def table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """A Markdown table."""
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    return "\n".join(lines)


def ratio(value: float) -> str:
    """A ratio with the digits that it deserves."""
    if value == 0:
        return "-"
    if value >= 1e4:
        return f"{value:.0e}".replace("e+0", "e").replace("e+", "e")
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def fronts(rows: list[Row], problems: dict[str, Problem]) -> str:
    """The comparison, scene by scene; where the goal is missed comes first."""
    compared = {name: front.compare(rows, name) for name in problems}
    missed = [c for c in compared.values() if c and not c["met"]]
    met = [c for c in compared.values() if c and c["met"]]
    alone = [name for name, c in compared.items() if c is None and any(r["scene"] == name for r in rows)]
    text = [
        f"Goal: at every error that any peer reaches, cheaper, and at least {front.FASTER:g} times cheaper "
        f"or, at equal cost, {front.NEARER:g} times more accurate.",
        "",
    ]
    if missed:
        text.append(f"**Missed in {len(missed)} of {len(missed) + len(met)} scenes:**\n")
        for c in missed:
            at = c["at"]
            faster = (
                f"{ratio(c['at_cheaper'])} times cheaper"
                if c["at_cheaper"] > 0
                else "no run of ours is as accurate"
            )
            text.append(
                f"- {problems[c['scene']].title}: met at {c['points_met']} of {c['points']} points of the "
                f"peers' front; at {at.method}'s error of {at.error:.1e} {faster}, at its cost "
                f"{ratio(c['at_nearer'])} times more accurate."
            )
        text.append("")
    else:
        text.append("Met in every scene that a peer gets right.\n")
    text.append(
        table(
            (
                "scene",
                "cheaper at equal error",
                "more accurate at equal cost, at least",
                "goal",
                "peers on the front",
            ),
            (
                (
                    problems[c["scene"]].title,
                    f"{ratio(c['cheaper'])} to {ratio(c['cheaper_most'])}",
                    ratio(c["nearer"]),
                    "met" if c["met"] else f"{c['points_met']} of {c['points']}",
                    ", ".join(c["peers"]),
                )
                for c in [*missed, *met]
            ),
        )
    )
    for name in alone:
        text.append(f"\nNo peer gets this right at any step: {problems[name].title}.")
    return "\n".join(text)


def settings(rows: list[Row], problem: Problem, notes: dict[str, str]) -> str:
    """What the peers were set to in a scene, and why some are not there."""
    lines = []
    for method in dict.fromkeys(row["method"] for row in rows if row["scene"] == problem.name):
        if method in front.OURS:
            continue
        row = next(row for row in rows if row["scene"] == problem.name and row["method"] == method)
        chosen = json.loads(row["settings"]) if row["settings"] else {}
        told = ", ".join(f"{key} {value}" for key, value in chosen.items()) or "its defaults"
        lines.append(f"- {method} {row['version']}: {told}")
    return "\n".join(lines) or "No peer takes part: " + notes.get(problem.name, "none was asked to.")


def stability(rows: list[Row]) -> str:
    """The map, and what each scene asks."""
    from .stability_scenes import CASES

    lines = [
        "The largest step, of a ladder from 1/15 s to 1/7680 s, at which this and all shorter ones give the "
        "right kind of answer; and at 1/240 s the hardest parameter up to which all do. Where a limit is "
        "known, it is beside.",
        "",
        "![Stability map](stability.png)",
        "",
        table(("scene", "right means"), ((case.name, case.asked) for case in CASES)),
        "",
        "`flipcar chart stability --peers`; every cell, with the reason where one ends, is in "
        "`stability.csv`.",
    ]
    return "\n".join(lines)


def ladder(rows: list[Row]) -> str:
    """The ladder, and the least model for some errors."""
    from .ladder import least

    wanted = (1e-1, 1e-2, 1e-3)
    models = [least(rows, error) for error in wanted]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    lines = [
        "What leaving a term out of the model costs in error and saves in time, scene by scene; a term that "
        "`scene.explain()` calls out has no error at all.",
        "",
        "![Model ladder](ladder.png)",
        "",
        "The cheapest model whose error at 240 Hz is at most:",
        "",
        table(
            ("scene", *(f"{error:g}" for error in wanted)),
            (
                (
                    scene,
                    *(
                        (", ".join(model[scene]) or "none of the terms")
                        if scene in model
                        else "a smaller step"
                        for model in models
                    ),
                )
                for scene in scenes
            ),
        ),
        "",
        "`flipcar chart ladder`",
    ]
    return "\n".join(lines)


def real(rows: list[Row], measures: dict[str, str], command: str) -> str:
    """A study of real impacts.

    Args:
        rows: of the study.
        measures: name and unit of each error.
        command: how to do it again.
    """

    def cells(row: Row):
        for name in measures:
            mean, low, high = row[f"{name}_mean"], row[f"{name}_low"], row[f"{name}_high"]
            yield f"{mean:.1f} ± {row[f'{name}_sd']:.1f} ({low:.1f} to {high:.1f})"

    head = ("data as", "terms", "fitted on", "judged on", "n", *(f"{k}, {v}" for k, v in measures.items()))
    body = (
        (row["model"], row["terms"], row["fitted_on"], row["judged_on"], f"{row['n']:.0f}", *cells(row))
        for row in rows
    )
    return "\n".join(
        [
            "Mean ± standard deviation, and the mean's 95 % confidence interval (bootstrap).",
            "",
            table(head, body),
            "",
            f"`{command}`",
        ]
    )


def reference(rows: list[Row]) -> str:
    """How far the independent integration is from the answers used."""
    columns = ("x_m", "attitude_rad", "v_m_s", "w_rad_s")
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    lines = [
        "The largest difference, over the restarts, between `exact` and an integration that shares no code "
        "with it:",
        "",
        table(
            ("scene", "restarts", "place, m", "attitude, rad", "velocity, m/s", "spin, rad/s"),
            (
                (
                    scene,
                    len(mine := [row for row in rows if row["scene"] == scene]),
                    *(f"{max(row[column] for row in mine):.1e}" for column in columns),
                )
                for scene in scenes
            ),
        ),
        "",
        "`flipcar chart reference`",
    ]
    return "\n".join(lines)


def write(folder: Path, problems: dict[str, Problem], parts: list[tuple[str, str]], rows: list[Row]) -> Path:
    """Write report.md.

    Args:
        folder: with the CSV files and figures.
        problems: of the work-precision study.
        parts: (title, text) of the other studies.
        rows: of the work-precision study.
    """
    machine = json.loads((folder / MACHINE).read_text())
    about = ", ".join(
        f"{name} {value}" for name, value in machine.items() if name not in ("date", "cpu", "quick")
    )
    text = [
        "# Speed against accuracy, and where methods fail",
        "",
        f"Measured on {machine['date']}, {machine['cpu']}; {about}. One thread. Drawn from the CSV files "
        "beside this page by `flipcar chart --redraw`; each part can be measured again by the command "
        "under it.",
        "",
        *(("**A quick look: few and coarse steps, each timed once.**", "") if machine["quick"] else ()),
        "## Known limitations",
        "",
        LIMITATIONS,
    ]
    there = {row["scene"] for row in rows}
    if there:
        text += ["## The front", "", fronts(rows, problems), "", "![Fronts](front.png)", ""]
        text += ["`flipcar chart --peers`", ""]
    for title, part in parts:
        text += [f"## {title}", "", part, ""]
    if there:
        text += ["## Work-precision, scene by scene", ""]
        text += [
            "Each curve runs over the step, 1/30 s to 1/30720 s, that of `exact` over its tolerance. A × is "
            "the finest step at which the answer is wrong.",
            "",
        ]
    for name, problem in problems.items():
        if name not in there:
            continue
        text += [
            f"### {problem.title[0].upper()}{problem.title[1:]}",
            "",
            f"Error: {problem.asks}. Known by: {problem.source}. Wrong from {problem.wrong:g} on.",
            "",
            f"![{problem.title}](precision-{name}.png)",
            "",
            settings(rows, problem, {}),
            "",
            f"`flipcar chart {name} --peers`",
            "",
        ]
    path = folder / "report.md"
    path.write_text("\n".join(text).rstrip() + "\n")
    return path
