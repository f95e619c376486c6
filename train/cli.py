"""The command line: `flipcar demo | train | eval | play | view | chart | settings | bench | warmup`."""

import json as json_module
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tqdm import tqdm

import flipcar_env
from flipcar_env.policy import Policy, load_policy
from flipcar_env.starts import KINDS

from .ppo import Config

START = Literal["roof", "side", "nose", "drop", "crash", "upright", "any"]


def demo(out: Path = Path("flipcar-demo.rrd"), seed: int = 0, json: bool = False) -> None:
    """Recover the car from each kind of start with the shipped policy, and record it.

    Needs neither torch nor a screen; with a screen the recording is opened.

    Args:
        out: recording to write.
        seed: of the starts.
        json: print the table as JSON.
    """
    from flipcar_env import recording

    episodes = _play("nominal", list(KINDS), seed, None)
    rows = [
        {
            "start": e.start,
            "success": e.is_success,
            "time_to_upright": e.time_to_upright,
            "work": float(e.work[-1]),
            "energy": float(e.energy[-1]),
        }
        for e in episodes
    ]
    recording.save(out, episodes)
    if json:
        print(json_module.dumps(rows, indent=2))
    else:
        print(f"{'start':<9}{'success':>8}{'time to upright, s':>20}{'energy, kJ':>12}{'work, kJ':>10}")
        for row in rows:
            upright = "-" if row["time_to_upright"] is None else f"{row['time_to_upright']:.2f}"
            print(
                f"{row['start']:<9}{'yes' if row['success'] else 'no':>8}{upright:>20}"
                f"{row['energy'] / 1e3:>12.2f}{row['work'] / 1e3:>10.2f}"
            )
        print(f"\nrecorded in {out}; watch it with: flipcar view {out}")
    if recording.has_display() and sys.stdout.isatty():
        recording.view(out)


def train(config: Annotated[Config, tyro.conf.arg(name="")]) -> None:
    """Train a policy with SB3's PPO and evaluate it."""
    try:
        import stable_baselines3  # noqa: F401
    except ImportError:
        sys.exit("flipcar train needs Stable-Baselines3: pip install 'flipcar[train]'")
    from .ppo import train as run

    out = run(config)
    print((out / "evaluation.json").read_text(), end="")
    print(f"run directory: {out}")


def evaluate(
    policy: tyro.conf.Positional[str] = "nominal",
    /,
    start: START = "any",
    episodes: int = 2000,
    seed: int | None = None,
    json: bool = False,
) -> None:
    """Play many unseen starts and count the recoveries.

    Args:
        policy: a shipped policy's name, or a file.
        start: kind of start.
        episodes: how many.
        seed: of the first start.
        json: print JSON.
    """
    from .evaluate import UNSEEN
    from .evaluate import evaluate as run

    result = run(load_policy(policy), start, episodes, UNSEEN if seed is None else seed)
    if json:
        print(json_module.dumps(result, indent=2))
        return
    low, high = result["wilson"]
    print(
        f"{policy}, start {start}: recovered {result['success']:.2%} of {episodes} "
        f"(95 % interval {low:.2%} to {high:.2%})"
    )
    if result["time_median"] is not None:
        print(
            f"time to upright: median {result['time_median']:.2f} s, "
            f"95th percentile {result['time_p95']:.2f} s; "
            f"median work {result['work_median'] / 1e3:.2f} kJ"
        )


def play(
    policy: tyro.conf.Positional[str] = "nominal",
    /,
    start: START = "roof",
    episodes: int = 1,
    seed: int = 0,
    state: Path | None = None,
    out: Path = Path("flipcar-play.rrd"),
) -> None:
    """Play episodes with a policy and record them.

    Args:
        policy: a shipped policy's name, or a file.
        start: kind of start.
        episodes: how many.
        seed: of the first.
        state: a saved state (.npy, from `get_state`) to start from instead.
        out: recording to write.
    """
    from flipcar_env import recording

    recorded = _play(policy, [start] * episodes, seed, state)
    recording.save(out, recorded)
    for e in recorded:
        ended = "not recovered" if e.time_to_upright is None else f"upright in {e.time_to_upright:.2f} s"
        print(f"start {e.start}: {ended}")
    print(f"recorded in {out}; watch it with: flipcar view {out}")


def view(file: tyro.conf.Positional[Path], /) -> None:
    """Open a recording in the rerun viewer, which listens on this machine only.

    Args:
        file: the recording (.rrd).
    """
    from flipcar_env import recording

    recording.view(file)


def chart(
    scenes: tyro.conf.Positional[tuple[str, ...]] = (),
    /,
    peers: bool = False,
    quick: bool = False,
    out: Path = Path("flipcar-chart"),
    redraw: bool = False,
    data: Path | None = None,
    model: Literal["recorded", "corrected"] | None = None,
    json: bool = False,
) -> None:
    """Chart speed against accuracy, map where methods fail, and meet real impacts.

    What is done is kept: after Ctrl-C, the same command goes on from there. `flipcar chart tosses` with
    --model, --json or a file prints how well real tosses are met.

    Args:
        scenes: names of scenes, and of the studies stability, ladder, reference, tosses, ellipses; all
            unless given.
        peers: other engines, too: those that are installed.
        quick: a coarse look at everything.
        out: folder for results, figures and report.
        redraw: measure nothing; draw again what the folder has, of whatever machine.
        data: folder with the real impacts; $FLIPCAR_DATA unless given. Or a file of tosses.
        model: of tosses; recorded: the data as it is; corrected: its lengths put right, the start refitted,
            the better contact model.
        json: of tosses: print JSON.
    """
    folder = os.environ.get("FLIPCAR_DATA")
    data = data or (Path(folder) if folder else None)
    if scenes == ("tosses",) and (json or model or data is None or data.suffix == ".npz"):
        _tosses(data, model or "recorded", json)
        return
    try:
        import matplotlib  # noqa: F401
        import scipy  # noqa: F401
    except ImportError:
        sys.exit("flipcar chart needs matplotlib and scipy: pip install 'flipcar[chart]'")
    from solver.chart import study

    bars: list[tqdm] = []

    def progress(title: str, pieces: int) -> Callable[[], None]:
        bars.append(tqdm(total=pieces, desc=title, unit="piece"))
        return bars[-1].update

    try:
        if not redraw:
            study.measure(scenes, peers, quick, out, data, progress, say=tqdm.write)
    except KeyboardInterrupt:
        sys.exit(f"stopped; what is done is kept in {out}, and the same command goes on from there")
    finally:
        for bar in bars:
            bar.close()
    print(f"report: {study.draw(out)}")


def _tosses(data: Path | None, model: str, json: bool) -> None:
    """Roll real tosses out, and print how far off they are."""
    from solver.chart import tosses

    if data is None:
        raise ValueError("data must be given with --data, or its folder in $FLIPCAR_DATA")
    loaded = tosses.load(data / "cube_tosses.npz" if data.is_dir() else data)
    result = tosses.summary(tosses.errors(loaded, tosses.MODELS[model]))
    if json:
        print(json_module.dumps(result))
        return
    print(f"{result['n']} tosses as {model}, {tosses.MODELS[model]}")
    print("position error {:.1f} ± {:.1f} % of the width".format(*result["position"]))
    print("rotation error {:.1f} ± {:.1f} degrees".format(*result["rotation"]))


def settings(quick: bool = False, out: Path = Path("flipcar-settings"), redraw: bool = False) -> None:
    """Find the cheapest step and method of the environment whose error no policy could notice.

    What is done is kept: after Ctrl-C, the same command goes on from there.

    Args:
        quick: a coarse look.
        out: folder for results and figure.
        redraw: measure nothing; conclude and draw again from what the folder has.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        sys.exit("flipcar settings needs matplotlib: pip install 'flipcar[chart]'")
    from solver.chart import store

    from . import settings_plot
    from .settings import cells
    from .settings_verdict import verdict

    if not redraw:
        store.claim(out, quick)
        jobs = [(key, lambda job=job: [job()]) for key, job in cells(quick)]
        with tqdm(total=len(jobs), unit="piece") as bar:
            store.fill(out / "settings.csv", jobs, bar.update)
    rows = store.read(out / "settings.csv")
    settings_plot.draw(rows, out / "settings.svg")
    print(verdict(rows))


def bench(rounds: int = 15, out: Path | None = None, json: bool = False) -> None:
    """Time the environment beside CartPole-v1 and MuJoCo, in turns, in this process.

    Args:
        rounds: how often each figure is taken.
        out: CSV file to write, with the machine and versions.
        json: print JSON.
    """
    from .bench import bench as run
    from .bench import write

    rows = run(rounds, lambda parts: tqdm(parts, unit="part", disable=json))
    if out is not None:
        write(out, rows)
    if json:
        print(json_module.dumps(rows, indent=2))
        return
    for row in rows:
        spread = "" if row["p10"] == row["p90"] else f"  ({row['p10']:g} to {row['p90']:g})"
        print(f"{row['figure']:32}{row['of']:26}{row['median']:>10g} {row['unit']}{spread}")


def warmup() -> None:
    """Compile everything that environments need now, so that later starts are quick."""
    import numpy as np

    from flipcar_env.core import FEW, Core

    before = time.perf_counter()
    _play("nominal", ["roof"], 0, None)
    drive = load_policy("nominal")
    core = Core(FEW + 1, obs=drive.obs)
    core.step(drive(core.observations()))
    core.put_states(core.states.copy(), np.arange(core.n))
    print(f"ready in {time.perf_counter() - before:.1f} s")


def _play(policy: str, kinds: list[str], seed: int, state: Path | None) -> list:
    """Episodes of a policy, one for each kind of start."""
    import numpy as np

    from flipcar_env.env import FlipCarEnv
    from flipcar_env.rollout import play as run

    drive: Policy = load_policy(policy)
    env = FlipCarEnv(obs=drive.obs)
    options = [{"start": kind} for kind in kinds]
    if state is not None:
        options = [{"state": np.load(state, allow_pickle=False)}]
    return [run(env, drive, seed + i, option, policy) for i, option in enumerate(options)]


COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": demo,
    "train": train,
    "eval": evaluate,
    "play": play,
    "view": view,
    "chart": chart,
    "settings": settings,
    "bench": bench,
    "warmup": warmup,
}


def main(arguments: list[str] | None = None) -> None:
    """Run a command; an error that the user can mend is one line."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        print(f"flipcar {flipcar_env.__version__}")
        return
    try:
        tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="flipcar", description=__doc__, args=arguments)
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"flipcar: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
