"""Drake: its discrete solvers (SAP) on point contacts."""

import logging
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from solver.chart.engine import EngineError
from solver.chart.peers.peer import Peer
from solver.chart.peers.shapes import shapes
from solver.rotation import to_matrix
from solver.scene import Scene

MODULES = [
    f"pydrake.{name}"
    for name in (
        "geometry", "math", "multibody.plant", "multibody.tree",
        "systems.analysis", "systems.framework", "systems.primitives",
    )
]  # fmt: skip


class Drake(Peer):
    """Drake's MultibodyPlant in discrete time, with point contacts.

    A box touches a half-space in one point there; so boxes are always spheres at their corners.

    Args:
        approximation: "sap", "lagged", "similar" or "tamsi".
        stiffness: of a point contact, N/m; past what a step can resolve SAP takes its near-rigid limit.
        relaxation: time in which SAP's contact damps, in steps; a short one springs back.
        dissipation: Hunt and Crossley's, s/m; for the others than SAP.
        near_rigid: SAP's threshold of that limit; smaller is harder.
        stiction: slip speed below which friction counts as sticking, m/s; not for SAP.
    """

    name = "Drake"
    package, module, extra = "drake", "pydrake", "drake"
    note = "contacts are compliant and friction regularised by design (point contacts; hydroelastic ones off)"
    defaults: ClassVar[dict[str, Any]] = {
        "approximation": "sap",
        "stiffness": 1e10,
        "relaxation": 10.0,
        "dissipation": 10.0,
        "near_rigid": 0.1,
        "stiction": 1e-4,
    }

    def refuses(self, scene: Scene) -> str | None:
        """Height fields, and restitution."""
        if scene.restitution > 0.0:
            return "Drake has no coefficient of restitution; its contacts dissipate instead"
        return super().refuses(scene)

    def world(self, scene: Scene, h: float) -> "_World":
        """The scene as a diagram with a discrete plant."""
        try:
            return _World(scene, h, self.settings)
        except RuntimeError as error:
            raise EngineError(f"Drake: {error}") from error


class _World:
    def __init__(self, scene: Scene, h: float, settings: dict[str, Any]):
        geometry, math, plants, tree, analysis, framework, primitives = map(import_module, MODULES)
        # Each half-space would be reported as unfit for deformable bodies.
        logging.getLogger("drake").setLevel(logging.ERROR)
        self.make, self.h = analysis.Simulator, h
        builder = framework.DiagramBuilder()
        config = plants.MultibodyPlantConfig(
            time_step=h,
            contact_model="point",
            discrete_contact_approximation=settings["approximation"],
            sap_near_rigid_threshold=settings["near_rigid"],
            stiction_tolerance=settings["stiction"],
            use_sampled_output_ports=False,
        )
        plant, _ = plants.AddMultibodyPlant(config, builder)
        plant.mutable_gravity_field().set_gravity_vector(scene.gravity)
        J = tree.RotationalInertia(*scene.body.principal_J)
        body = plant.AddRigidBody(
            "body", tree.SpatialInertia.MakeFromCentralInertia(scene.body.m, [0, 0, 0], J)
        )

        def material() -> Any:
            # Two shapes in contact have half the stiffness of each, and the sum of their relaxations.
            properties = geometry.ProximityProperties()
            geometry.AddContactMaterial(
                properties,
                dissipation=settings["dissipation"],
                point_stiffness=2.0 * settings["stiffness"],
                friction=plants.CoulombFriction(scene.friction, scene.friction),
            )
            properties.AddProperty("material", "relaxation_time", settings["relaxation"] * h / 2.0)
            return properties

        _box, spheres, frame, point = shapes(scene, boxes=False)
        ground = math.RigidTransform(math.RotationMatrix(frame), point)
        plant.RegisterCollisionGeometry(
            plant.world_body(), ground, geometry.HalfSpace(), "ground", material()
        )
        for k, (*centre, radius) in enumerate(spheres):
            at = math.RigidTransform(centre)
            plant.RegisterCollisionGeometry(body, at, geometry.Sphere(radius), f"point {k}", material())
        plant.Finalize()
        # A torque in body axes, without Python in the loop: a propeller of no thrust along each axis.
        turns = [math.RotationMatrix.MakeFromOneVector(axis, 2) for axis in np.eye(3)]
        propellers = builder.AddSystem(
            plants.Propeller(
                [
                    plants.PropellerInfo(body.index(), math.RigidTransform(R, [0, 0, 0]), 0.0, 1.0)
                    for R in turns
                ]
            )
        )
        source = builder.AddSystem(primitives.ConstantVectorSource(np.zeros(3)))
        builder.Connect(source.get_output_port(), propellers.get_command_input_port())
        builder.Connect(plant.get_body_poses_output_port(), propellers.get_body_poses_input_port())
        builder.Connect(
            propellers.get_spatial_forces_output_port(), plant.get_applied_spatial_force_input_port()
        )
        self.plant, self.source, self.diagram = plant, source, builder.Build()

    def put(self, row):
        self.simulator = self.make(self.diagram)
        context = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(context)
        self.torque = self.source.get_mutable_source_value(self.source.GetMyMutableContextFromRoot(context))
        x, quat, v, w = row[:3], row[3:7], row[7:10], to_matrix(row[3:7]) @ row[10:]
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([quat, x, w, v]))
        self.simulator.Initialize()
        self.done = 0

    def go(self, n, torque):
        if n == 0:
            return
        if torque is not None:
            self.torque.set_value(torque)
        self.done += n
        # Steps are taken at 0, h, 2h ...: half a step before the end all n are done, whatever the rounding.
        try:
            self.simulator.AdvanceTo((self.done - 0.5) * self.h)
        except RuntimeError as error:
            raise EngineError(f"Drake: {error}") from error

    def row(self):
        y = self.plant.GetPositionsAndVelocities(self.context)
        quat, x, w, v = y[:4], y[4:7], y[7:10], y[10:]
        return np.concatenate([x, quat, v, to_matrix(quat).T @ w])
