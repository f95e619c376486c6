"""Real tosses of a cube, rolled out open loop."""

import json
import os
import pathlib

import numpy as np
import pytest

from solver.chart import tosses

DATA = pathlib.Path(os.environ.get("FLIPCAR_DATA") or "missing") / "cube_tosses.npz"


@pytest.mark.skipif(not DATA.is_file(), reason="the data set is not here; set FLIPCAR_DATA to its folder")
def test_real_tosses_are_met_as_recorded(capsys, monkeypatch):
    from train.cli import main

    main(["chart", "tosses", "--data", str(DATA), "--model", "recorded", "--json"])
    result = json.loads(capsys.readouterr().out)
    assert result["n"] == 364
    assert result["position"][0] <= 15
    assert result["rotation"][0] <= 20


def test_a_toss_of_our_own_is_met_exactly(tmp_path):
    """A file written from a simulation gives no error, and one row of it changed gives that error."""
    from solver import Body, Scene, State, simulate

    dt, width = 1 / 148, 0.0524
    body = Body(0.37, np.full(3, 0.00081), Body.box(0.37, np.full(3, 2 * width)).hull)
    scene = Scene(body, friction=tosses.FRICTION, restitution=tosses.RESTITUTION)
    state = State([0, 0, 0.2], [1, 0, 0, 0], [1, 0, 0], [1, 2, 3])
    run = simulate(scene, state, 60 * dt, dt=dt / 2, record_every=2)
    from solver.rotation import to_matrix

    w_b = np.einsum("tji,tj->ti", to_matrix(run.quat), run.w)
    frames = np.column_stack([run.quat, run.x, w_b, run.v])

    def write(frames):
        np.savez(
            tmp_path / "t.npz", state=frames, offsets=[0, len(frames)], dt=dt, half_width=width,
            mass=0.37, inertia=np.full(3, 0.00081), gravity=9.81,
        )  # fmt: skip
        return tosses.summary(tosses.errors(tosses.load(tmp_path / "t.npz")))

    result = write(frames)
    assert result["position"][0] < 1e-3
    assert result["rotation"][0] < 1e-3
    frames[1:, 4] += 0.01  # a centimetre off in x in all frames but the first
    moved = write(frames)
    assert moved["position"][0] == pytest.approx(100 * 0.01 / (2 * width) * 60 / 61, rel=1e-3)


def test_a_file_that_is_not_one_of_tosses_is_refused(tmp_path):
    np.savez(tmp_path / "x.npz", a=1)
    with pytest.raises(ValueError, match="is not a file of tosses"):
        tosses.load(tmp_path / "x.npz")
