"""Results as CSV files in one folder: one machine's, one row at a time, so that nothing done is lost."""

import csv
import json
import platform
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

Row = dict[str, Any]
Cell = tuple[tuple[str, ...], Callable[[], list[Row]]]
"""A key that names the work, and the work itself: it returns rows."""

PACKAGES = ("flipcar", "numpy", "numba", "mujoco", "pybullet", "rapier3d", "drake")
MACHINE = "machine.json"


def machine() -> Row:
    """What the figures depend on: CPU, system, versions."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {"cpu": _cpu(), "system": platform.system(), "python": platform.python_version(), **versions}


def _cpu() -> str:
    """The processor's name, where the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def claim(folder: Path, quick: bool) -> None:
    """Make the folder this machine's, for a quick look or for the whole.

    Raises:
        ValueError: it holds results of another kind, machine or version: times would not compare.
    """
    folder.mkdir(parents=True, exist_ok=True)
    here, path = {**machine(), "quick": quick}, folder / MACHINE
    if path.exists():
        there = json.loads(path.read_text())
        differ = [name for name in here | there if name != "date" and here.get(name) != there.get(name)]
        if differ:
            told = ", ".join(f"{name} {there.get(name)!r} there, {here.get(name)!r} here" for name in differ)
            raise ValueError(
                f"out holds the results that these would not compare with ({told}); give another folder, "
                "or --redraw to draw what is there"
            )
    else:
        path.write_text(json.dumps({"date": datetime.now(UTC).date().isoformat(), **here}, indent=1) + "\n")


def read(path: Path) -> list[Row]:
    """The rows of a CSV file, numbers as floats; none if there is no such file."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    """A cell of a CSV file: a float where it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def fill(path: Path, cells: Iterable[Cell], done: Callable[[], None]) -> None:
    """Do the cells that the file does not have yet, and append their rows, which all have the same names.

    Args:
        path: of the CSV file.
        cells: what to do.
        done: called after each cell, also after one that was there.
    """
    there = {row["key"] for row in read(path)}
    for key, work in cells:
        name = "|".join(key)
        if name not in there:
            rows = [{"key": name, **row} for row in work()]
            begin = not path.exists()
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                if begin:
                    writer.writeheader()
                writer.writerows(rows)
        done()
