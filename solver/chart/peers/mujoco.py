"""MuJoCo: soft convex contacts, stepped in its own C loop."""

from typing import Any, ClassVar

import numpy as np

from solver.chart.engine import EngineError
from solver.chart.peers.peer import Peer
from solver.chart.peers.shapes import shapes
from solver.rotation import from_matrix
from solver.scene import Scene

COMPLAINTS = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC", "mjWARN_CONTACTFULL", "mjWARN_CNSTRFULL")

SINGLE_STAGE = ("mjINT_EULER", "mjINT_IMPLICITFAST")


class MuJoCo(Peer):
    """MuJoCo with one of its integrators; a subclass names which.

    A contact is a soft spring and damper, `aref = -b v - k r`. Its `timeconst` is counted in steps: so it
    gets harder as the step gets smaller, as far as is stable.

    Args:
        timeconst: of `solref`, in steps; below 2 MuJoCo's own limit on it is switched off.
        dampratio: of `solref`; near 1 a hard contact springs back.
        bounce: in place of both a damper alone, b = (1 + e)/h, which turns v into −e v in one step: the way
            to a restitution that MuJoCo's manual gives. Nothing then takes out an overlap.
        impedance: of `solimp`, constant over the depth; at most 0.9999.
        cone: "elliptic" or "pyramidal".
        impratio: how much harder friction is than the normal force.
        iterations: of the Newton solver, at most.
        tolerance: of the Newton solver.
        noslip_iterations: of the solver that afterwards takes the friction's softness out.
        diagexact: take the contact's exact 1/G where MuJoCo scales the impedance.
        speculative: contacts that the next step would make.
        boxes: a box where the hull is one, otherwise spheres at its corners.
    """

    package = module = "mujoco"
    note = "contacts are soft and friction is regularised by design: a body at rest sinks and creeps a little"
    integrator: ClassVar[str]
    defaults: ClassVar[dict[str, Any]] = {
        "timeconst": 2.0,
        "dampratio": 3.0,
        "bounce": False,
        "impedance": 0.9999,
        "cone": "elliptic",
        "impratio": 100.0,
        "iterations": 100,
        "tolerance": 1e-10,
        "noslip_iterations": 0,
        "diagexact": False,
        "speculative": False,
        "boxes": True,
    }

    def refuses(self, scene: Scene) -> str | None:
        """Height fields; and restitution, unless by `bounce` in a single stage."""
        if scene.restitution > 0.0:
            if not self.settings["bounce"]:
                return (
                    "MuJoCo has no coefficient of restitution; how far its soft contacts spring back is not e"
                )
            if self.integrator not in SINGLE_STAGE:
                return (
                    "a damper that turns v into −e v in one step needs an integrator that sees it once a step"
                )
        return super().refuses(scene)

    def world(self, scene: Scene, h: float) -> "_World":
        """The scene as a model of one free body and a plane."""
        return _World(scene, h, self.integrator, self.settings)


class MuJoCoEuler(MuJoCo):
    """MuJoCo, semi-implicit Euler."""

    name, integrator = "MuJoCo Euler", "mjINT_EULER"


class MuJoCoImplicitfast(MuJoCo):
    """MuJoCo, implicit in velocity."""

    name, integrator = "MuJoCo implicitfast", "mjINT_IMPLICITFAST"


class MuJoCoRK4(MuJoCo):
    """MuJoCo, fourth-order Runge-Kutta."""

    name, integrator = "MuJoCo RK4", "mjINT_RK4"


class MuJoCoDiscrete(MuJoCo):
    """MuJoCo, its new integrator that solves the contacts for the step's end."""

    name, integrator = "MuJoCo discrete", "mjINT_DISCRETE"
    defaults: ClassVar[dict[str, Any]] = {**MuJoCo.defaults, "timeconst": 0.5, "dampratio": 4.0}


class _World:
    def __init__(self, scene: Scene, h: float, integrator: str, settings: dict[str, Any]):
        import mujoco

        # Its warnings are read from the data; by itself it would write them to a file in the working folder.
        mujoco.set_mju_user_warning(lambda text: None)
        self.step = mujoco.mj_step
        spec = mujoco.MjSpec()
        spec.option.timestep = h
        spec.option.gravity = scene.gravity
        spec.option.integrator = getattr(mujoco.mjtIntegrator, integrator)
        spec.option.cone = getattr(mujoco.mjtCone, f"mjCONE_{settings['cone'].upper()}")
        for option in ("impratio", "iterations", "tolerance", "noslip_iterations"):
            setattr(spec.option, option, settings[option])
        disable, enable = mujoco.mjtDisableBit, mujoco.mjtEnableBit
        # A bad state must stay bad: MuJoCo would start over from its default pose.
        spec.option.disableflags |= int(disable.mjDSBL_AUTORESET)
        if settings["timeconst"] < 2.0:
            spec.option.disableflags |= int(disable.mjDSBL_REFSAFE)
        if settings["diagexact"]:
            spec.option.enableflags |= int(enable.mjENBL_DIAGEXACT)
        if settings["speculative"]:
            spec.option.enableflags |= int(enable.mjENBL_SPECULATIVE)
        solref = [settings["timeconst"] * h, settings["dampratio"]]
        if settings["bounce"]:  # MuJoCo takes negative numbers as −k and −b, and divides b by the impedance
            solref = [0.0, -settings["impedance"] * (1.0 + scene.restitution) / h]
        contact = {
            "friction": [scene.friction, 0.0, 0.0],
            "condim": 3 if scene.friction > 0.0 else 1,
            "solref": solref,
            "solimp": [settings["impedance"], settings["impedance"], 1.0, 0.5, 2.0],
        }
        box, spheres, frame, point = shapes(scene, settings["boxes"])
        geom = mujoco.mjtGeom
        spec.worldbody.add_geom(
            type=geom.mjGEOM_PLANE, size=[0, 0, 1], pos=point, quat=from_matrix(frame), **contact
        )
        body = spec.worldbody.add_body(explicitinertial=True, mass=scene.body.m, inertia=[1, 1, 1])
        body.add_freejoint()
        if box is not None:
            body.add_geom(
                type=geom.mjGEOM_BOX, size=box.half, pos=box.centre, quat=from_matrix(box.axes), **contact
            )
        for *centre, radius in spheres:
            body.add_geom(type=geom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=centre, **contact)
        self.model = spec.compile()
        # Set afterwards: compiling would refuse a flat or thin body for the last digit of J1 + J2 >= J3.
        self.model.body_inertia[1] = scene.body.principal_J
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        self.reset = mujoco.mj_resetData
        self.complaints = [(name, int(getattr(mujoco.mjtWarning, name))) for name in COMPLAINTS]

    def put(self, row):
        self.reset(self.model, self.data)
        self.data.qpos[:] = row[:7]
        self.data.qvel[:] = row[7:]  # a free joint's: v in world, w in body axes

    def go(self, n, torque):
        if torque is not None:
            self.data.qfrc_applied[3:] = torque  # body axes, as the joint's w
        self.step(self.model, self.data, n)

    def row(self):
        for name, k in self.complaints:
            if self.data.warning[k].number:
                raise EngineError(
                    f"MuJoCo warned {name.removeprefix('mjWARN_')} at t = {self.data.time:.6g} s"
                )
        return np.concatenate([self.data.qpos, self.data.qvel])
