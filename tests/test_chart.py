"""The charts: their problems, their store, what they conclude, and a quick run of all of it."""

import csv
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle import random_quat

from solver.chart import front, store
from solver.chart.engine import EngineError, Ours
from solver.chart.plots import apart
from solver.chart.precision import measured
from solver.chart.problems import problems
from solver.chart.store import claim, fill, read
from solver.chart.sweep import best
from solver.rotation import angle, from_vector, product
from train.cli import main


@pytest.mark.parametrize("name", list(problems()))
def test_exact_meets_every_known_answer(name):
    problem = problems()[name]
    run = Ours("exact").play(
        problem.scene, problem.starts, problem.duration, problem.records, 1, problem.torque
    )
    assert problem.error(run) < (1e-6 if name == "tippe" else 2e-9)


@given(st.integers(0, 2**32 - 1), st.floats(0, np.pi))
def test_the_angle_between_equal_attitudes_is_exactly_none(seed, turned):
    """Whatever the processor fuses: a model that changes nothing is to have the error 0."""
    a, axis = random_quat(rng := np.random.default_rng(seed)), rng.normal(size=3)
    b = product(from_vector(turned * axis / np.linalg.norm(axis)), a)
    assert angle(a, a) == angle(a, -a) == 0.0
    np.testing.assert_allclose([angle(a, b), angle(-b, a)], turned, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", list(problems()))
def test_an_error_is_seen(name):
    """The article's method at 30 Hz meets none of them."""
    problem = problems()[name]
    steps = round(30 * problem.duration / problem.records)
    row, _took = measured(problem, Ours("acceleration"), steps, 1)
    assert row["failed"] or row["error"] > 1e-6


def test_rows_that_are_there_are_not_made_again(tmp_path):
    path, made = tmp_path / "rows.csv", []

    def cell(name):
        def work():
            if name == "stops" and "stops" not in made:
                made.append(name)
                raise KeyboardInterrupt
            made.append(name)
            return [{"scene": name, "error": 0.1 + 0.2, "why": "a, b"}]

        return (name,), work

    cells = [cell("one"), cell("stops"), cell("two")]
    with pytest.raises(KeyboardInterrupt):
        fill(path, cells, lambda: None)
    assert [row["scene"] for row in read(path)] == ["one"]
    fill(path, cells, lambda: None)
    assert made == ["one", "stops", "stops", "two"]
    assert [row["error"] for row in read(path)] == [0.1 + 0.2] * 3
    assert read(path)[0]["why"] == "a, b"


def test_results_of_another_machine_are_not_mixed(tmp_path, monkeypatch):
    claim(tmp_path, quick=False)
    claim(tmp_path, quick=False)
    with pytest.raises(ValueError, match="quick"):
        claim(tmp_path, quick=True)
    monkeypatch.setattr(store, "_cpu", lambda: "another")
    with pytest.raises(ValueError, match="another"):
        claim(tmp_path, quick=False)


def rows(*runs):
    """(method, error, ns) or (method, error, ns, why it failed)."""
    return [
        {"scene": "s", "method": m, "error": e, "ns": ns, "failed": (*why, "")[0]} for m, e, ns, *why in runs
    ]


def test_the_front_compares_at_equal_error_and_at_equal_cost():
    peers = [("MuJoCo RK4", 1e-2, 1e6), ("PyBullet", 1e-3, 1e8), ("Rapier", 1e-9, 1.0, "wrong: error 1")]
    won = front.compare(rows(("impulse", 1e-3, 1e4), ("exact", 1e-12, 1e7), *peers), "s")
    assert won["met"]
    assert won["cheaper"] == pytest.approx(100)
    assert won["points"] == 2
    slow = front.compare(rows(("impulse", 1e-3, 1e5), *peers), "s")
    assert not slow["met"]
    assert (slow["at"].method, slow["cheaper"]) == ("MuJoCo RK4", pytest.approx(10))
    never = front.compare(rows(("impulse", 5e-3, 1e3), *peers), "s")
    assert not never["met"]
    assert never["cheaper"] == 0
    assert front.compare(rows(("impulse", 5e-3, 1e3)), "s") is None


def test_the_best_settings_have_the_least_error_and_a_run_that_ends_is_worst():
    def tried(settings, rate, error, failed=""):
        return {
            "scene": "s", "method": "m", "settings": settings, "rate": rate, "error": error, "failed": failed
        }  # fmt: skip

    found = best(
        [tried('{"a": 1}', 120, 1e-3), tried('{"a": 1}', 960, "", "stopped"), tried("{}", 120, 1e-2),
         tried("{}", 960, 1e-3)],
        {"s": 0.5},
    )  # fmt: skip
    assert found == {("s", "m"): {}}


def test_a_run_that_cannot_go_on_or_is_wrong_says_so():
    class Stops(Ours):
        def play(self, *args):
            raise EngineError("no longer finite")

    problem = problems()["block"]
    row, _took = measured(problem, Stops("impulse"), 8, 2)
    assert row["failed"] == "no longer finite"
    assert row["error"] == ""
    row, _took = measured(problems()["slope"], Ours("acceleration"), 8, 2)
    assert row["failed"].startswith("wrong")


def test_labels_are_moved_apart_and_stay_inside():
    moved = np.array(apart([0.0, 0.0, 0.1, 1.0, 1.0], 0.15, 0.0, 1.0))
    assert np.diff(np.sort(moved)).min() > 0.149
    assert moved.min() > -0.08
    assert moved.max() < 1.08


def test_a_quick_look_at_everything_and_drawing_it_again(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("FLIPCAR_DATA", raising=False)
    out = tmp_path / "chart"
    main(["chart", "--peers", "--quick", "--out", str(out)])
    told = capsys.readouterr()
    assert "left out" in told.out + told.err  # the real impacts, which are not there
    report = (out / "report.md").read_text()
    for name, problem in problems().items():
        assert f"precision-{name}.png" in report, problem.title
    for name in ("front", "stability", "ladder", "precision-skid"):
        for suffix in (".svg", ".png"):
            assert (out / (name + suffix)).stat().st_size > 5000
    assert report.index("Known limitations") < report.index("The front")
    with (out / "precision.csv").open() as file:
        table = list(csv.DictReader(file))
    assert {"impulse", "exact", "MuJoCo Euler", "PyBullet", "Rapier"} <= {row["method"] for row in table}
    assert json.loads((out / "machine.json").read_text())["quick"]

    before = (out / "report.md").read_bytes(), (out / "precision.csv").read_bytes()
    (out / "report.md").unlink()
    main(["chart", "--peers", "--quick", "--out", str(out)])  # all there: it measures nothing
    assert ((out / "report.md").read_bytes(), (out / "precision.csv").read_bytes()) == before
    main(["chart", "--redraw", "--out", str(out)])
    assert (out / "report.md").read_bytes() == before[0]


def test_a_scene_that_is_none_is_refused(tmp_path):
    with pytest.raises(SystemExit, match="bakery"):
        main(["chart", "bakery", "--out", str(tmp_path / "chart")])
