"""Starting: where compiled code is kept, what is said meanwhile, workers that are forked or spawned."""

import multiprocessing
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flipcar_env import core, settle, starts
from flipcar_env.core import Core

ROOT = Path(__file__).parents[1]
SMALL = "from flipcar_env.policy import load_policy; import numpy as np; load_policy('nominal')(np.zeros(10))"


@pytest.fixture
def installed(tmp_path):
    """A copy of the packages where no __pycache__ can be made, as in a read-only installation."""
    for package in ("solver", "flipcar_env"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
        for folder in (tmp_path / package, *(d for d in (tmp_path / package).rglob("*") if d.is_dir())):
            (folder / "__pycache__").write_text("in the way")
    return tmp_path


def run(installed, home, count=1):
    environment = {**os.environ, "PYTHONPATH": str(installed), "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-B", "-c", SMALL]
    runs = [
        subprocess.Popen(command, env=environment, cwd=installed, stderr=subprocess.PIPE, text=True)
        for _ in range(count)
    ]
    for process in runs:
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors


def test_two_at_once_from_a_folder_that_cannot_be_written_to(installed, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    run(installed, home, count=2)
    assert list(home.rglob("*.nbi")), "kept in the user's own cache"


def test_where_nothing_can_be_written_to(installed, tmp_path):
    nowhere = tmp_path / "nowhere"
    nowhere.write_text("not a folder")
    run(installed, nowhere)


def test_long_waits_are_announced_and_short_ones_are_not(capfd, monkeypatch):
    with core.announced():
        pass
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(core, "PATIENCE", 0.0)
    with core.announced():
        core.threading.Event().wait(0.2)
    assert "compiling" in capfd.readouterr().err


def _stepped(threads):
    batch = Core(12, threads=threads)
    for i in range(12):
        batch.seed(i, i)
    batch.begin(np.arange(12))
    for _ in range(5):
        batch.step(np.ones((12, 3), np.float32))
    return batch.rows.copy()


def _worker(queue, threads):
    queue.put(_stepped(threads))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_forked_and_spawned_after_threads_have_run(method):
    here = _stepped(2)
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    worker = context.Process(target=_worker, args=(queue, 2))
    worker.start()
    there = queue.get(timeout=300)
    worker.join()
    np.testing.assert_array_equal(there, here)


def test_the_settled_attitudes_are_this_cars():
    with np.load(ROOT / "flipcar_env" / "settled.npz") as data:
        assert str(data["car"]) == settle.fingerprint(), "make them again: python -m flipcar_env.settle"
        np.testing.assert_array_equal(data["attitudes"], starts.settled())
    attitudes = starts.settled()
    assert attitudes.shape == (2, settle.BANK, 4)
    assert len(np.unique(attitudes.round(3), axis=1)[0]) > 4


def test_settling_finds_attitudes_at_rest():
    assert abs(np.linalg.norm(settle.settle(1), axis=-1) - 1).max() < 1e-12
