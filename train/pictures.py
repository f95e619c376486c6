"""The README's pictures: `make pictures`, or `python -m train.pictures FOLDER`."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from flipcar_env import picture, rollout, terrain
from flipcar_env.env import FlipCarEnv
from flipcar_env.policy import load_policy

SEED = 0
"""Of the roof start that is shown."""

MOMENTS = (0.0, 0.22, 0.5, 0.66, 0.8, 1.0)
"""Shares of the recovery's time: it begins slowly."""
DRAWN, LEFT, TOP, FRAME = (640, 480), 155, 100, (370, 270)
"""Pixels that are drawn of a moment, and what is shown of them."""


MENU = 37
"""Pixels of the viewer's menu."""


def recovery(path: Path) -> None:
    """A strip of moments of a recovery from the roof by the shipped policy."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    policy = load_policy("nominal")
    env = FlipCarEnv(start="roof")
    obs, _ = env.reset(seed=SEED)
    states, done = [env.get_state()], False
    while not done:
        obs, _, terminated, truncated, info = env.step(policy(obs))
        states.append(env.get_state())
        done = terminated or truncated
    still = info["time_to_upright"] - 0.5  # it has to stand for half a second
    steps = (np.array(MOMENTS) * still / env.core.control_dt).astype(int)
    width, height = FRAME
    frames = picture.draw(np.array(states)[steps], terrain.surface("level"), *DRAWN)
    frames = frames[:, TOP : TOP + height, LEFT : LEFT + width]
    n = len(MOMENTS)
    figure = plt.figure(figsize=(n * width / 100, height / 100), dpi=100)
    for i, (frame, step) in enumerate(zip(frames, steps, strict=True)):
        axes = figure.add_axes((i / n, 0, 1 / n, 1))
        axes.imshow(frame)
        axes.axis("off")
        axes.text(10, height - 12, f"{step * env.core.control_dt:.1f} s", fontsize=16, color="white")
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)


def viewer(path: Path, at: float = 1.4) -> None:
    """What the viewer shows of an episode over bumpy ground; needs a graphics driver, a software one will do.

    Args:
        path: PNG to write.
        at: moment of the episode, s.
    """
    from rerun.experimental import ViewerClient

    from flipcar_env import recording
    from flipcar_env.recording.viewer import end, start

    env = FlipCarEnv(terrain="bumpy")
    episode = rollout.play(env, load_policy("nominal"), SEED, {"start": "roof"}, "nominal")
    with tempfile.TemporaryDirectory() as folder:
        file = recording.save(Path(folder) / "episode.rrd", [episode])
        process, url = start(headless=True, size="1600x900")
        try:
            client = _patiently(lambda: ViewerClient.connect(url))
            client.open(str(file))
            _patiently(lambda: client.get_state().views[0])
            client.set_time(recording.TIMELINE, duration=at, play_state="paused")
            time.sleep(8.0)  # until it is drawn, and has said that it has no window
            client.save_screenshot(str(path.absolute()))
        finally:
            end(process)
    without_menu(path)


def without_menu(path: Path) -> None:
    """Cut off the viewer's own menu: it tells of this machine."""
    import matplotlib.image

    matplotlib.image.imsave(path, matplotlib.image.imread(path)[MENU:])


def _patiently(call, seconds: float = 30.0):
    """Call until it works."""
    last = time.monotonic() + seconds
    while True:
        try:
            return call()
        except Exception:
            if time.monotonic() > last:
                raise
            time.sleep(0.2)


def main(folder: Path) -> None:
    """Draw them all; charts and maps from what is measured, the others from what the shipped policy does."""
    from solver.chart import store, study

    from . import heatmap, settings_plot

    recovery(folder / "recovery.png")
    viewer(folder / "viewer.png")
    for file in sorted(folder.glob("task/*/success.csv")):
        heatmap.draw(store.read(file), file.with_suffix(".png"))
    settings_plot.draw(store.read(folder / "settings" / "settings.csv"), folder / "settings" / "settings.svg")
    study.draw(folder / "chart")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
