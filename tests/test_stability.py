"""The stability map: its judges can fail, naive methods fail at their limits, and ours does not fail."""

import csv

import numpy as np
import pytest

from solver.chart import naive, stability
from solver.chart.engine import Ours
from solver.chart.stability_naive import NAIVE, Naive
from solver.chart.stability_plot import draw, label
from solver.chart.stability_scenes import CASES

CASE = {case.name: case for case in CASES}
OF = {engine.name: engine for engine in NAIVE}
IMPULSE, EXACT = Ours("impulse", lean=False, timed=False), Ours("exact", timed=False)


def right(engine, scene, hz, value=None):
    case = CASE[scene]
    return stability.attempt(engine, case, case.nominal if value is None else value, hz)[0]


FALLS = Naive("falls", (), lambda scene, state, h: naive.fly(state, state.v + h * scene.gravity, state.w, h))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_judge_says_no(case):
    """To a body that no ground holds; of the spins, to the explicit gyroscopic term."""
    engine = OF["explicit spin"] if case.name.endswith("-spin") else FALLS
    assert not right(engine, case.name, 60)


@pytest.mark.parametrize(
    ("method", "scene", "good", "bad"),
    [
        ("explicit spin", "slender-spin", 480, 240),
        ("implicit spin", "slender-spin", 480, 240),
        ("quaternion Euler", "slender-spin", 240, 120),
        ("Newton's e every step", "lossless-bounce", 1920, 960),
        ("popped-out positions", "lossless-bounce", 960, 240),
        ("Newton's e every step", "settling-ball", 7680, 3840),
        ("tests at step ends", "bullet", 960, 480),
        ("tests at step ends", "dip", 960, 480),
    ],
)
def test_naive_methods_fail_beyond_the_step_that_theory_says(method, scene, good, bad):
    h = stability.limit(method, CASE[scene], "dt")
    assert 1 / good < h < 1 / bad
    assert right(OF[method], scene, good)
    assert not right(OF[method], scene, bad)


@pytest.mark.parametrize(
    ("method", "scene", "good", "bad"),
    [
        ("explicit spin", "slender-spin", 5.0, 10),
        ("Newton's e every step", "lossless-bounce", 4, 6),
        ("popped-out positions", "lossless-bounce", 5, 15),
        ("tests at step ends", "bullet", 6, 9),
        ("tests at step ends", "dip", 15, 16),
        ("all contacts at once", "flat-landing", 1.0, 1.6),
        ("f = -l/G, friction", "painleve-rod", 1.0, 1.4),
    ],
)
def test_naive_methods_fail_beyond_the_scene_that_theory_says(method, scene, good, bad):
    limit = stability.limit(method, CASE[scene], CASE[scene].varied)
    assert good < limit < bad
    assert right(OF[method], scene, 240, good)
    assert not right(OF[method], scene, 240, bad)


def test_baumgarte_in_the_velocity_fails_at_short_steps():
    row = stability.row(OF["Baumgarte β φ/h"], CASE["overlap"], "dt", (960, 480, 240, 120))
    assert 1 / 480 < row["limit_analytic"] < 1 / 240
    assert row["largest"] == ""
    assert row["note"] == "never, but right at 0.00416667 0.00833333"
    assert label(row)[0] == "1/240\nto 1/120"


@pytest.mark.parametrize(
    ("method", "scene"),
    [
        ("fixed-length L", "slender-spin"),
        ("no stabilisation", "top"),
        ("Eq. 8 every frame", "rocking"),
        ("all contacts at once", "flat-landing"),
        ("switching f < 0 off", "edge"),
        ("scalar friction", "throw"),
        ("scalar friction impact", "rod-strike"),
        ("Newton's e, friction", "rod-strike"),
        ("regularised friction", "slope"),
        ("f = -l/G, friction", "painleve-rod"),
    ],
)
def test_other_naive_methods_fail_at_240_hz(method, scene):
    assert not right(OF[method], scene, 240)


def test_impulse_survives_every_scene():
    """With a step of 1/30 s; and at 1/240 s the hardest value of each."""
    for case in CASES:
        assert stability.attempt(IMPULSE, case, case.nominal, 30) == (True, ""), case.name
        assert stability.attempt(IMPULSE, case, case.values[-1], 240) == (True, ""), case.name


def test_exact_survives_every_scene_that_it_takes():
    for case in CASES:
        if case.name == "overlap":
            row = stability.row(EXACT, case, "dt", (240,))
            assert row["note"].startswith("n/a: state is 0.01 m deep")
            assert row["largest"] == ""
        else:
            assert stability.attempt(EXACT, case, case.nominal, 30) == (True, ""), case.name


class Broken(Naive):
    def play(self, *args, **kwargs):
        run = super().play(*args, **kwargs)
        run.x[-1] = np.nan
        return run


def test_what_is_not_finite_is_not_right():
    assert stability.attempt(Broken("", (), FALLS.step), CASE["slope"], 0.5, 15) == (False, "not finite")


def test_a_quick_map_and_its_picture(tmp_path):
    cells = stability.cells([IMPULSE], quick=True)
    keys = [key for key, _make in cells]
    assert len(set(keys)) == len(keys)
    rows = [make() for key, make in cells if key[0] in ("impulse", "explicit spin")]
    assert {row["method"] for row in rows} == {"impulse", "explicit spin"}
    for row in rows:
        if row["method"] == "impulse":
            assert row["largest"] == (1 / 30 if row["varied"] == "dt" else CASE[row["scene"]].values[-1])
    with open(tmp_path / "rows.csv", "w+", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
        file.seek(0)
        files = draw(csv.DictReader(file), tmp_path / "map")
    assert [file.suffix for file in files] == [".svg", ".png"]
    assert min(file.stat().st_size for file in files) > 10_000
