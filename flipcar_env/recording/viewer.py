"""The viewer's process. Whatever is started here listens on the loopback address only."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import rerun_cli

LOOPBACK = "127.0.0.1"

PLACES = ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun")
"""Of the viewer in its package, by platform."""

KEPT = "256MB"
"""Of what a server holds for a viewer that joins late; it forgets the oldest."""

TO_END = 5.0
"""s that a viewer has to end when told to."""


def has_display() -> bool:
    """Is there a screen to open a window on?"""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def command(*arguments: str, port: str = "auto") -> list[str]:
    """The viewer's command line: by default it would listen on every interface.

    It is the viewer itself: `rerun` on the PATH is a wrapper that may leave it behind when interrupted.

    Raises:
        RuntimeError: there is no viewer.
    """
    folder = Path(rerun_cli.__file__).parent
    for place in PLACES:
        if (folder / place).is_file():
            return [str(folder / place), "--bind", LOOPBACK, "--port", port, *arguments]
    raise RuntimeError(f"no viewer in {folder}: pip install --force-reinstall rerun-sdk")


def view(path: str | Path) -> None:
    """Open a recording in rerun's viewer; returns when its window is closed.

    Args:
        path: an .rrd file.

    Raises:
        FileNotFoundError: there is no such file.
        RuntimeError: there is no screen or no viewer, or it failed.
    """
    path = Path(path)
    if not has_display():
        raise RuntimeError(
            f"no screen (neither DISPLAY nor WAYLAND_DISPLAY is set): "
            f"copy {path} to a machine with one and run `rerun {path.name}` there"
        )
    if not path.is_file():
        raise FileNotFoundError(f"no recording at {path}")
    status = subprocess.run(command(str(path)), check=False).returncode
    if status != 0:
        raise RuntimeError(f"the viewer stopped with exit status {status} on {path}")


def start(headless: bool = False, size: str = "1280x720") -> tuple[subprocess.Popen, str]:
    """Start a viewer that waits for data; with no screen, a server that a viewer elsewhere can join.

    Args:
        headless: a viewer without a window.
        size: of what is drawn without a window.

    Returns:
        Its process, and where it listens.

    Raises:
        RuntimeError: there is no viewer.
    """
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        port = str(free.getsockname()[1])
    url = f"rerun+http://{LOOPBACK}:{port}/proxy"
    if headless:
        how = ["--hide-welcome-screen", "--headless", "--window-size", size]
    elif has_display():
        how = ["--hide-welcome-screen"]
    else:
        how = ["--serve-grpc", "--server-memory-limit", KEPT]
        print(
            f"flipcar: no screen here; to watch from a machine with one: "
            f"ssh -L {port}:{LOOPBACK}:{port} HERE, and there rerun --connect {url}",
            file=sys.stderr,
        )
    process = subprocess.Popen(command(*how, port=port), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return process, url


def end(process: subprocess.Popen) -> None:
    """End a viewer, whatever it does."""
    process.terminate()
    try:
        process.wait(TO_END)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
