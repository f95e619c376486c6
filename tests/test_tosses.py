"""Real tosses of a cube, rolled out open loop."""

import json
import os
import pathlib

import numpy as np
import pytest

from solver import State, simulate
from solver.chart import tosses
from solver.rotation import to_matrix

DATA = pathlib.Path(os.environ.get("FLIPCAR_DATA") or "missing") / "cube_tosses.npz"
needs_data = pytest.mark.skipif(
    not DATA.is_file(), reason="the data set is not here; set FLIPCAR_DATA to its folder"
)
DT, WIDTH = 1 / 148, 0.0524
FIRST = State([0, 0, 0.2], [1, 0, 0, 0], [1, 0, 0], [1, 2, 3])


def file_of(folder, *tosses_of_frames):
    offsets = np.cumsum([0, *map(len, tosses_of_frames)])
    np.savez(
        folder / "t.npz", state=np.concatenate(tosses_of_frames), offsets=offsets, dt=DT, half_width=WIDTH,
        mass=0.37, inertia=np.full(3, 0.00081), gravity=9.81,
    )  # fmt: skip
    return tosses.load(folder / "t.npz")


def frames_of(folder, model, first=FIRST, n=60):
    """What a tracker would see of a toss of the model, in the file's lengths."""
    scene = tosses.scene_of(file_of(folder, np.eye(1, 13)), model)
    run = simulate(scene, first, n * DT, dt=DT / 2, record_every=2)
    w_b = np.einsum("tji,tj->ti", to_matrix(run.quat), run.w)
    return np.column_stack([run.quat, run.x / model.lengths, w_b, run.v / model.lengths])


@needs_data
@pytest.mark.parametrize(
    ("model", "position", "rotation"), [("recorded", 12.5, 16.5), ("corrected", 10.6, 13.8)]
)
def test_real_tosses_are_met(model, position, rotation, capsys):
    from train.cli import main

    main(["chart", "tosses", "--data", str(DATA), "--model", model, "--json"])
    result = json.loads(capsys.readouterr().out)
    assert result["n"] == 364
    assert result["position"][0] <= position
    assert result["rotation"][0] <= rotation


@needs_data
def test_the_study_has_a_line_for_each_term():
    rows = tosses.study(DATA, quick=True)
    assert {f"without {term}" for term in tosses.TERMS} <= {row["terms"] for row in rows}
    for row in rows:
        assert row["position_low"] <= row["position_mean"] <= row["position_high"]
        assert row["rotation_low"] <= row["rotation_mean"] <= row["rotation_high"]


def test_a_toss_of_our_own_is_met_exactly(tmp_path):
    """A file written from a simulation gives no error, and one row of it changed gives that error."""
    model = tosses.MODELS["recorded"]
    frames = frames_of(tmp_path, model)

    def measured(frames):
        return tosses.summary(tosses.errors(file_of(tmp_path, frames), model))

    result = measured(frames)
    assert result["position"][0] < 1e-3
    assert result["rotation"][0] < 1e-3
    frames[1:, 4] += 0.01  # a centimetre off in x in all frames but the first
    moved = measured(frames)
    assert moved["position"][0] == pytest.approx(100 * 0.01 / (2 * WIDTH) * 60 / 61, rel=1e-3)


def test_a_start_is_found_from_the_flight_alone(tmp_path):
    """Wrong velocities in the file do not matter, nor does anything from the first contact on."""
    model = tosses.MODELS["corrected"]
    frames = frames_of(tmp_path, model)
    data = file_of(tmp_path, frames)
    n = tosses.flight(data, data.frames[0], model.lengths)
    assert 15 < n < 40
    frames[:, 7:] = np.random.default_rng(0).normal(size=(61, 6))
    frames[n:, 4:6] += 0.1
    frames[n:, 6] *= 0.5
    [found] = tosses.starts(file_of(tmp_path, frames), model)
    np.testing.assert_allclose(found[:3], FIRST.x, atol=1e-9)
    np.testing.assert_allclose(found[3:7], FIRST.quat, atol=1e-9)
    np.testing.assert_allclose(found[7:10], FIRST.v, atol=1e-8)
    np.testing.assert_allclose(found[10:], FIRST.w, atol=1e-7)


@pytest.mark.parametrize("name", tosses.MODELS)
def test_short_tosses_and_starts_in_contact_are_taken(name, tmp_path):
    """One frame; too few to fit a start; a start on the board, and one a corner deep in it; none at all."""
    model = tosses.MODELS[name]
    frames = frames_of(tmp_path, model)
    rest = frames[-1:] * np.where(np.arange(13) == 6, 0.0, 1.0) + np.where(np.arange(13) == 6, 0.05, 0.0)
    deep = frames_of(tmp_path, model, State([0, 0, 0.06], FIRST.quat, [0, 0, 0], [0, 0, 0]), n=5)
    deep[:, 6] = 0.03
    data = file_of(tmp_path, frames[:1], frames[:3], frames[:0], rest, deep, frames)
    table = tosses.errors(data, model)
    assert table.shape == (5, 2)
    assert np.isfinite(table).all()
    assert (table[:2] < 1e-3).all()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"state": None}, "is not a file of tosses"),
        ({"state": np.full((4, 13), np.nan)}, "must be finite"),
        ({"state": np.ones((4, 12))}, r"shape \(T, 13\)"),
        ({"offsets": [0, 9]}, "offsets must span"),
        ({"offsets": [0, 3, 2]}, "never fall"),
    ],
)
def test_a_file_that_is_not_one_of_tosses_is_refused(tmp_path, changed, message):
    good = {
        "state": np.ones((4, 13)), "offsets": [0, 4], "dt": DT, "half_width": WIDTH, "mass": 0.37,
        "inertia": np.ones(3), "gravity": 9.81,
    }  # fmt: skip
    parts = {key: value for key, value in {**good, **changed}.items() if value is not None}
    np.savez(tmp_path / "x.npz", **parts)
    with pytest.raises(ValueError, match=message):
        tosses.load(tmp_path / "x.npz")
