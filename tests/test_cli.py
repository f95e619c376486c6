"""The command line, as a user calls it."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

import flipcar_env


def flipcar(*arguments, cwd, env=None, ok=True):
    done = subprocess.run(
        [sys.executable, "-c", "from train.cli import main; main()", *map(str, arguments)],
        cwd=cwd, env={**os.environ, **(env or {})}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert (done.returncode == 0) == ok, done.stderr
    return done


def test_demo_recovers_from_every_start_without_torch_or_a_screen(tmp_path):
    import rerun_cli

    (tmp_path / "block.py").write_text(
        "import sys\n"
        "class Missing:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('torch', 'stable_baselines3'):\n"
        "            raise ImportError(f'{name} is not here')\n"
        "sys.meta_path.insert(0, Missing())\n"
        "from train.cli import main\nmain()\n"
    )
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "block.py", "demo"],
        cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[1:7]] == list(
        ("roof", "side", "nose", "drop", "crash", "upright")
    )
    assert all(line.split()[1] == "yes" for line in lines[1:7]), done.stdout
    binary = pathlib.Path(rerun_cli.__file__).parent / "rerun"
    verify = subprocess.run([binary, "rrd", "verify", "flipcar-demo.rrd"], cwd=tmp_path)
    assert verify.returncode == 0


def test_play_and_eval(tmp_path):
    import numpy as np

    state = flipcar_env.FlipCarEnv()
    state.reset(seed=0, options={"start": "side"})
    np.save(tmp_path / "state.npy", state.get_state())
    done = flipcar("play", "nominal", "--state", "state.npy", "--out", "x.rrd", cwd=tmp_path)
    assert "upright in" in done.stdout
    assert (tmp_path / "x.rrd").stat().st_size > 10_000
    arguments = ("--start", "upright", "--terrain", "slope", "--out", "y.rrd")
    done = flipcar("play", "nominal", "pd", "--compare", *arguments, cwd=tmp_path)
    assert [line.split(",")[0] for line in done.stdout.splitlines()[:2]] == ["nominal", "pd"]
    flipcar("play", "--grid", "--episodes", "3", *arguments, cwd=tmp_path)
    done = flipcar("eval", "--start", "side", "--episodes", "50", "--json", cwd=tmp_path)
    (result,) = json.loads(done.stdout)
    assert result["success"] > 0.9
    assert result["wilson"][0] <= result["success"] <= result["wilson"][1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train", "--resume", "nowhere"], ["resume must be a run directory", "nowhere"]),
        (["eval", "missing.npz"], ["policy must be one of", "'nominal'", "missing.npz"]),
        (
            ["chart", "tosses", "--data", "missing.npz"],
            ["data must be a file of tosses", "missing"],
        ),
        (["chart", "tosses"], ["--data", "FLIPCAR_DATA"]),
        (["view", "missing.rrd"], ["flipcar: "]),
        (["play", "nominal", "pd"], ["policies must be one", "--compare", "pd"]),
        (["play", "--out", "/nowhere/at/all.rrd"], ["/nowhere/at/all.rrd"]),
    ],
)
def test_errors_are_one_line(arguments, words, tmp_path):
    env = {"FLIPCAR_DATA": ""}
    done = flipcar(*arguments, cwd=tmp_path, env=env, ok=False)
    assert "Traceback" not in done.stderr
    line = done.stderr.strip().splitlines()[-1]
    for word in words:
        assert word in line


def test_training_without_torch_says_what_to_install(tmp_path):
    (tmp_path / "torch.py").write_text("raise ImportError('not here')\n")
    env = {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    done = flipcar("train", "--out", "run", cwd=tmp_path, env=env, ok=False)
    (line,) = done.stderr.strip().splitlines()
    assert "pip install 'flipcar[train]'" in line
    assert not (tmp_path / "run").exists()


def test_version_and_help(tmp_path):
    assert flipcar("--version", cwd=tmp_path).stdout == f"flipcar {flipcar_env.__version__}\n"
    text = flipcar("--help", cwd=tmp_path).stdout
    for command in (
        "demo",
        "train",
        "eval",
        "search",
        "calibrate",
        "play",
        "view",
        "chart",
        "settings",
        "bench",
        "warmup",
    ):
        assert command in text
        assert flipcar(command, "--help", cwd=tmp_path).stdout


def test_training_runs_and_leaves_what_it_promises(tmp_path):
    done = flipcar(
        "train", "--steps", "2048", "--num-envs", "8", "--eval-episodes", "20", "--out", "run", cwd=tmp_path
    )
    assert "steps/s" in done.stderr
    run = tmp_path / "run"
    assert {p.name for p in run.iterdir()} >= {
        "config.json", "progress.csv", "model.zip", "policy.npz", "evaluation.json",
    }  # fmt: skip
    config = json.loads((run / "config.json").read_text())
    assert config["seed"] == 0
    assert config["versions"]["numba"]
    flipcar_env.load_policy(run / "policy.npz")


def test_bench_reports_ratios_taken_in_one_run(tmp_path):
    done = flipcar("bench", "--rounds", "1", "--json", "--out", "bench.csv", cwd=tmp_path)
    rows = json.loads(done.stdout)
    assert all(0 < row["p10"] <= row["median"] <= row["p90"] for row in rows)
    figures = {row["figure"] for row in rows}
    assert {"CartPole-v1 / FlipCar-v0", "MuJoCo / FlipCar", "two threads / one", "memory"} <= figures
    shares = [row["median"] for row in rows if "PPO" in row["figure"] and row["unit"] == "%"]
    assert sum(shares) == pytest.approx(100, abs=0.1)
    assert "cpu" in (tmp_path / "bench.csv").read_text()
