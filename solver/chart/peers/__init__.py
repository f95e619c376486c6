"""Other engines on the same scenes: MuJoCo, PyBullet, Rapier, Drake."""

from importlib.util import find_spec
from typing import Any

from solver.chart.engine import EngineError
from solver.chart.peers.drake import Drake
from solver.chart.peers.mujoco import MuJoCoDiscrete, MuJoCoEuler, MuJoCoImplicitfast, MuJoCoRK4
from solver.chart.peers.peer import Peer
from solver.chart.peers.pybullet import PyBullet
from solver.chart.peers.rapier import Rapier
from solver.chart.peers.sweeps import SWEEPS
from solver.errors import one_of

__all__ = ["PEERS", "SWEEPS", "engines", "make", "missing"]

PEERS: dict[str, type[Peer]] = {
    peer.name: peer
    for peer in (MuJoCoEuler, MuJoCoImplicitfast, MuJoCoRK4, MuJoCoDiscrete, PyBullet, Rapier, Drake)
}

QUICK = ("MuJoCo Euler", "PyBullet", "Rapier")
"""One of each package that is loaded in no time."""


def engines(quick: bool = False) -> list[Peer]:
    """The engines that are installed, each with its default settings; only a few of them if quick."""
    absent = missing()
    return [PEERS[name]() for name in (QUICK if quick else PEERS) if name not in absent]


def missing() -> dict[str, str]:
    """The engines that are not installed, by name, and how to install them."""
    return {
        name: f"{name} is not installed; pip install 'flipcar[{peer.extra}]' brings it"
        for name, peer in PEERS.items()
        if find_spec(peer.module) is None
    }


def make(name: str, **settings: Any) -> Peer:
    """An engine by name.

    Args:
        name: one of `PEERS`.
        settings: in place of its defaults.

    Raises:
        ValueError: no such engine or setting.
        EngineError: it is not installed.
    """
    one_of("name", name, PEERS)
    absent = missing()
    if name in absent:
        raise EngineError(absent[name])
    return PEERS[name](**settings)
