"""The settings that are tried for each engine; a chart takes the best of them, scene by scene."""

from typing import Any

_MUJOCO: list[dict[str, Any]] = [
    {},
    {"dampratio": 1.0},
    {"dampratio": 10.0},
    {"timeconst": 4.0},
    {"impedance": 0.99},
    {"impratio": 1.0},
    {"impratio": 1e4},
    {"noslip_iterations": 3},
    {"cone": "pyramidal", "impratio": 1.0},
    {"diagexact": True},
    {"speculative": True, "boxes": False, "dampratio": 10.0},
]

_DAMPER: list[dict[str, Any]] = [{"bounce": True}]

SWEEPS: dict[str, list[dict[str, Any]]] = {
    "MuJoCo Euler": _MUJOCO + _DAMPER,
    "MuJoCo implicitfast": _MUJOCO + _DAMPER,
    "MuJoCo RK4": _MUJOCO,
    "MuJoCo discrete": [
        {},
        {"timeconst": 0.5, "dampratio": 10.0},
        {"timeconst": 1.0, "dampratio": 1.0},
        {"timeconst": 2.0, "dampratio": 1.0},
        {"timeconst": 2.0, "dampratio": 3.0},
        {"impratio": 1.0},
        {"impratio": 1e4},
        {"noslip_iterations": 3},
        {"cone": "pyramidal", "impratio": 1.0},
        {"speculative": True, "boxes": False},
    ],
    "PyBullet": [
        {},
        {"iterations": 20},
        {"iterations": 400},
        {"residual": 1e-7},
        {"erp": 0.8},
        {"erp": 0.0, "split": False},
        {"breaking": 0.02},
        {"boxes": True, "breaking": 0.02},
        {"slop": 1e-4},
        {"maximal": False, "split": False, "erp": 0.02},
        {"maximal": False, "split": False, "boxes": True, "breaking": 0.02},
        {"maximal": False, "split": False, "cone": False},
    ],
    "Rapier": [
        {},
        {"prediction": 1e-4},
        {"prediction": 1e-3},
        {"friction": "COULOMB"},
        {"friction": "COULOMB", "boxes": False},
        {"iterations": 1},
        {"iterations": 16},
        {"internal": 10},
        {"stabilization": 0},
        {"frequency": 60.0, "damping": 5.0, "prediction": 0.02},
        {"ccd": True, "prediction": 1e-3},
        {"frequency": 30.0, "damping": 10.0, "prediction": 0.02, "slop": 0.005, "biased": False},
    ],
    "Drake": [
        {},
        {"near_rigid": 1.0},
        {"near_rigid": 1e-3},
        {"relaxation": 1.0},
        {"relaxation": 3.0},
        {"stiffness": 1e6},
        {"approximation": "lagged"},
        {"approximation": "lagged", "stiffness": 1e7, "dissipation": 100.0},
        {"approximation": "similar"},
        {"approximation": "tamsi", "dissipation": 100.0},
        {"approximation": "tamsi", "stiffness": 1e6, "stiction": 1e-3},
    ],
}
"""By engine, each entry what it changes of the defaults."""
