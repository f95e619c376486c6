"""Why the environment steps as it does: errors fall, episodes are `evaluate.play`'s, the verdict can fail."""

from inspect import signature

import numpy as np
import pytest

from flipcar_env import load_policy
from flipcar_env.core import Core
from flipcar_env.starts import KINDS
from train import settings, settings_plot, settings_verdict
from train.evaluate import UNSEEN, play, summary, wilson
from train.settings import DEFAULT, EMPTY, FINER, NOTICED


@pytest.fixture(scope="module")
def rows():
    cells = settings.cells(quick=True)
    assert len({key for key, _job in cells}) == len(cells)
    return [job() for _key, job in cells]


def test_the_default_is_the_environments():
    assert signature(Core).parameters["substeps"].default == DEFAULT
    found = settings.terms()["note"]
    assert "friction" in found.split("out:")[0]


def test_every_row_has_the_same_columns_and_is_finite(rows):
    for row in rows:
        assert list(row) == list(EMPTY)
        assert np.isfinite([value for value in row.values() if not isinstance(value, str)]).all()
        assert row["quantity"] == "terms" or row["failed"] in ("", 0)


def test_errors_fall_with_the_step(rows):
    """Second order: a tenth of the step leaves less than a thirtieth of the error."""
    for column in ("action_p50", "action_p95", "obs_p50", "obs_p95"):
        one, ten = (
            settings_verdict.pick(rows, "error", method="impulse", substeps=n, control_steps=1)[0][column]
            for n in (1, 10)
        )
        assert 0.0 < ten < one / 30, column
    for horizon in settings.HORIZONS:
        found = settings_verdict.pick(rows, "error", method="impulse", control_steps=horizon)
        assert (np.diff([row["obs_p95"] for row in found]) < 0.0).all()
    for method in ("acceleration", "baumgarte"):
        (wrong,) = settings_verdict.pick(rows, "error", method=method)
        assert wrong["action_p95"] > NOTICED


def test_the_exact_method_agrees_with_what_errors_are_measured_against(monkeypatch):
    monkeypatch.setattr("solver.chart.engine.MAX_ROUNDS", 1)
    row = settings.rival("exact", 1, quick=True)
    assert row["failed"] == 0
    assert row["obs_p50"] < 1e-7
    assert row["action_p95"] < 1e-5


@pytest.mark.parametrize("start", ["nose", "crash"])
def test_success_is_what_evaluate_counts(start):
    mine = settings.success(DEFAULT, start, 30)
    right = summary(play(load_policy("nominal"), UNSEEN + np.arange(30), start=start))
    assert mine["success"] == right["success"]
    assert [mine["low"], mine["high"]] == right["wilson"]
    assert mine["time_median"] == pytest.approx(right["time_median"], rel=1e-12)


def test_the_verdict_and_the_figure_come_from_rows_as_a_file_gives_them(rows, tmp_path):
    read = [{name: float(v) if isinstance(v, int) else v for name, v in row.items()} for row in rows]
    text = settings_verdict.verdict(read)
    assert text == settings_verdict.verdict(rows)
    assert text.count("\n") == 2
    n = settings_verdict.cheapest(read)
    assert n == DEFAULT
    assert settings_verdict.noticed(read, n) < NOTICED <= settings_verdict.noticed(read, 1)
    assert "the default, is the cheapest" in text
    assert "agree within the 95 % interval" in text
    settings_plot.draw(read, tmp_path / "settings.svg")
    assert (tmp_path / "settings.png").stat().st_size > 10_000
    text = (tmp_path / "settings.svg").read_text()
    assert "in all but 1" in text
    assert "of 250 steps" in text


def counted(substeps, start, recovered, n):
    low, high = wilson(recovered, n)
    return EMPTY | {
        "quantity": "success", "method": "impulse", "substeps": substeps, "start": start, "n": n,
        "success": recovered / n, "low": low, "high": high,
    }  # fmt: skip


def erring(substeps, action, failed=0):
    return EMPTY | {
        "quantity": "error", "method": "impulse", "substeps": substeps, "control_steps": 1, "failed": failed,
        "action_rare": action,
    }  # fmt: skip


def test_the_interval_of_a_difference_is_newcombes():
    """56 of 70 less 48 of 80: 0.0524 to 0.3339 (Stat. Med. 17:873, table II, method 10)."""
    pair = [counted(1, "roof", 56, 70), counted(FINER, "roof", 48, 80)]
    d, low, high = settings_verdict.differences(pair, 1)["roof"]
    np.testing.assert_allclose([d, low, high], [0.2, 0.0524, 0.3339], atol=5e-5)


@pytest.mark.parametrize(
    ("coarse", "fine", "n", "agree"),
    [(2000, 2000, 2000, True), (1999, 2000, 2000, True), (18, 20, 20, True), (1940, 1980, 2000, False),
     (1980, 1940, 2000, False)],
)  # fmt: skip
def test_success_may_differ(coarse, fine, n, agree):
    cost = EMPTY | {"quantity": "cost", "method": "impulse", "substeps": 1, "ns": 5000.0, "ratio": 1.0}
    rows = [erring(1, NOTICED / 2), cost]
    for start in KINDS:
        lost = start == "side"
        rows += [
            counted(1, start, coarse if lost else n, n),
            counted(FINER, start, fine if lost else n, n),
        ]
    text = settings_verdict.verdict(rows)
    assert ("they agree within the 95 % interval" in text) == agree
    assert ("they differ from start side" in text) == (not agree)
    assert "not the default" in text


def test_the_cheapest_is_one_that_no_policy_notices():
    rows = [erring(1, 0.3), erring(2, 0.005, failed=1), erring(5, 0.009), erring(5, 0.02), erring(10, 0.001)]
    assert settings_verdict.cheapest(rows) == 10
    rows.remove(rows[-1])
    assert settings_verdict.cheapest(rows) is None
    assert "No setting tried" in settings_verdict.verdict(rows)
