"""The command line: `flipcar demo | train | eval | search | calibrate | play | view | chart | ...`."""

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

from .config import Config

START = Literal["roof", "side", "nose", "drop", "crash", "upright", "any"]
TERRAIN = Literal["level", "slope", "bumpy", "ditch"]
EVERY_START: tuple[START, ...] = ("roof", "side", "nose", "drop", "crash", "upright")


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


def train(config: Annotated[Config, tyro.conf.arg(name="")], resume: Path | None = None) -> None:
    """Train a policy with Stable-Baselines3 and evaluate it.

    What is learned is kept every so often: after Ctrl-C, or worse, --resume goes on to the same bits.

    Args:
        config: of the run.
        resume: directory of a run to go on with; whatever else is given counts for nothing.
    """
    try:
        import stable_baselines3  # noqa: F401
    except ImportError:
        sys.exit("flipcar train needs Stable-Baselines3: pip install 'flipcar[train]'")
    from . import learner

    try:
        out = learner.train(config) if resume is None else learner.resume(resume)
    except KeyboardInterrupt:
        sys.exit("stopped; flipcar train --resume with its run directory goes on")
    print((out / "evaluation.json").read_text(), end="")
    print(f"run directory: {out}")


def evaluate(
    policy: tyro.conf.Positional[str] = "nominal",
    /,
    agent: Literal["zero", "random", "constant", "pd", "autoflip", "search"] | None = None,
    start: tuple[START, ...] = EVERY_START,
    terrain: tuple[TERRAIN, ...] = ("level",),
    randomize: bool = False,
    episodes: int = 10_000,
    seed: int | None = None,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Play stratified, unseen starts and count the recoveries.

    Args:
        policy: a shipped policy's name, or a file.
        agent: one that has learned nothing, instead; "search" takes seconds a start.
        start: kinds of start.
        terrain: kinds of ground.
        randomize: a car of its own for each episode.
        episodes: of each kind on each terrain.
        seed: of the first start.
        out: folder for evaluation.json, success over roll and pitch, and states of the starts that failed.
        json: print JSON.
    """
    from . import assess
    from .evaluate import UNSEEN

    if out is not None:
        _need_matplotlib("eval --out")
    arguments: dict[str, Any] = {"randomize": True} if randomize else {}

    def bar(steps, name):
        return tqdm(steps, desc=name, leave=False, disable=json)

    if agent == "constant":
        rows = assess.constant_rows(start, terrain, episodes, **arguments)
    elif agent == "search":
        drive = _guide(policy)
        arguments["obs"] = drive.obs
        rows = assess.found(assess.search_rows(drive, start, terrain, episodes, bar, **arguments))
    else:
        player = assess.AGENTS[agent]() if agent else load_policy(policy)
        arguments["obs"] = player.obs if isinstance(player, Policy) else "egocentric"
        first = UNSEEN if seed is None else seed
        rows = assess.policy_rows(player, start, terrain, episodes, first, out, bar, **arguments)
    if json:
        print(json_module.dumps(rows, indent=2))
        return
    print(f"{agent or policy}, {episodes} starts each")
    for row in rows:
        print(assess.line(row))
    if out is not None:
        print(f"in {out}: evaluation.json, success.csv and its heat map, failures")


def search(
    policy: tyro.conf.Positional[str] = "nominal",
    /,
    start: tuple[START, ...] = EVERY_START,
    terrain: tuple[TERRAIN, ...] = ("level", "slope", "bumpy", "ditch"),
    episodes: int = 200,
    out: Path = Path("search.csv"),
) -> None:
    """Search for the quickest recovery from each of many starts: what `flipcar eval` compares with.

    Args:
        policy: no start is recovered later than by it; see `train/search.py`.
        start: kinds of start.
        terrain: kinds of ground.
        episodes: starts of each kind on each terrain.
        out: CSV to write.
    """
    from . import assess

    drive = _guide(policy)

    def bar(groups, name):
        return tqdm(groups, desc=name)

    rows = assess.search_rows(drive, start, terrain, episodes, bar, obs=drive.obs)
    assess.write(out, rows)
    for row in assess.found(rows):
        print(assess.line(row))


def calibrate(episodes: int = 2000, out: Path | None = None, json: bool = False) -> None:
    """Measure how hard the task is: what agents recover that have learned nothing, from resting starts.

    Args:
        episodes: of each kind.
        out: CSV to write.
        json: print JSON.
    """
    from . import assess
    from .calibrate import calibrate as run

    rows = run(episodes, lambda agents: tqdm(agents, disable=json))
    if out is not None:
        assess.write(out, rows)
    if json:
        print(json_module.dumps(rows, indent=2))
        return
    for row in rows:
        print(f"{row['agent']:16}{row['start']:10}{row['recovered']:8.2%}  {row['limit']}")


def play(
    policies: tyro.conf.Positional[tuple[str, ...]] = ("nominal",),
    /,
    compare: bool = False,
    grid: bool = False,
    start: START = "roof",
    terrain: TERRAIN = "level",
    randomize: bool = False,
    episodes: int = 1,
    seed: int = 0,
    state: Path | None = None,
    out: Path = Path("flipcar-play.rrd"),
) -> None:
    """Play episodes with a policy and record them: one after another, side by side or all at once.

    Args:
        policies: a shipped policy's name, a file, or zero, random, pd, autoflip; several with --compare.
        compare: from the same start, side by side.
        grid: all cars in one scene.
        start: kind of start.
        terrain: kind of ground.
        randomize: a car of its own for each episode.
        episodes: how many of each policy.
        seed: of the first.
        state: a saved state (.npy, from `get_state`) to start from instead.
        out: recording to write.
    """
    from flipcar_env import recording

    if compare and grid:
        raise ValueError("compare and grid are two layouts; give one of them")
    if len(policies) > 1 and not (compare or grid):
        raise ValueError(f"policies must be one unless --compare is given, got {' '.join(policies)}")
    arguments: dict[str, Any] = {"terrain": terrain, "randomize": randomize}
    recorded = [
        one for policy in policies for one in _play(policy, [start] * episodes, seed, state, **arguments)
    ]
    save = recording.save_comparison if compare else recording.save_grid if grid else recording.save
    save(out, recorded)
    for e in recorded:
        ended = "not recovered" if e.time_to_upright is None else f"upright in {e.time_to_upright:.2f} s"
        print(f"{e.policy}, start {e.start}: {ended}")
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


def _need_matplotlib(command: str) -> None:
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        sys.exit(f"flipcar {command} needs matplotlib: pip install 'flipcar[chart]'")


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
    _need_matplotlib("settings")
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


def _guide(policy: str) -> Policy:
    """A policy that sees what the search's own agents do."""
    drive = load_policy(policy)
    if not drive.obs.startswith("egocentric"):
        raise ValueError(
            f"policy must observe 'egocentric' or 'egocentric+action' to guide a search, got {drive.obs!r}"
        )
    return drive


def _play(policy: str, kinds: list[str], seed: int, state: Path | None, **arguments: Any) -> list:
    """Episodes of a policy, or of an agent that has learned nothing, one for each kind of start."""
    import numpy as np

    from flipcar_env.env import FlipCarEnv
    from flipcar_env.rollout import play as run

    from .assess import AGENTS

    drive: Callable[[np.ndarray], np.ndarray]
    if policy in AGENTS:
        agent, obs = AGENTS[policy](), "egocentric"
        drive = lambda seen: agent(seen[None])[0]  # noqa: E731
    else:
        drive = load_policy(policy)
        obs = drive.obs
    env = FlipCarEnv(obs=obs, **arguments)
    options = [{"start": kind} for kind in kinds]
    if state is not None:
        options = [{"state": np.load(state, allow_pickle=False)}]
    return [run(env, drive, seed + i, option, policy) for i, option in enumerate(options)]


COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": demo,
    "train": train,
    "eval": evaluate,
    "search": search,
    "calibrate": calibrate,
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
