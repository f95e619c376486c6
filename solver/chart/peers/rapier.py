"""Rapier, in single precision: small steps of a soft sequential-impulse solver."""

from typing import Any, ClassVar

import numpy as np

from solver.chart.engine import EngineError
from solver.chart.peers.peer import Peer
from solver.chart.peers.shapes import shapes
from solver.rotation import from_matrix, to_matrix
from solver.scene import Scene

FAST = 1e9
"""m/s: where it clamps velocities, out of the way."""


class Rapier(Peer):
    """Rapier through rapier3d.

    Args:
        iterations: substeps a step (`num_solver_iterations`).
        internal: sweeps over the contacts in each of them.
        stabilization: sweeps afterwards that take out the velocity which corrected an overlap.
        frequency: of the spring that takes overlaps out, Hz.
        damping: ratio of that spring.
        slop: the overlap that is left alone, m.
        prediction: how far ahead contacts are made, m; a far one takes the speed that would bounce.
        friction: "COULOMB", a cone at each point, of which four together hold up to 10 % less, by direction;
            or "SIMPLIFIED", one cone for up to four points.
        biased: friction also in the sweeps that take out overlaps: less creep.
        ccd: continuous collision detection.
        boxes: a box where the hull is one, otherwise spheres at its corners.
    """

    name = "Rapier"
    package = module = "rapier3d"
    note = "its Python package computes in single precision; overlaps leave by a soft spring"
    defaults: ClassVar[dict[str, Any]] = {
        "iterations": 4,
        "internal": 1,
        "stabilization": 1,
        "frequency": 1000.0,
        "damping": 1.0,
        "slop": 0.0,
        "prediction": 0.01,
        "friction": "SIMPLIFIED",
        "biased": True,
        "ccd": False,
        "boxes": True,
    }

    def world(self, scene: Scene, h: float) -> "_World":
        """The scene as a physics world in one thread."""
        return _World(scene, h, self.settings)


class _World:
    def __init__(self, scene: Scene, h: float, settings: dict[str, Any]):
        import rapier3d

        self.rapier, self.scene, self.h, self.settings = rapier3d, scene, h, settings

    def put(self, row):
        rapier, settings, body = self.rapier, self.settings, self.scene.body
        self.world = world = rapier.PhysicsWorld(gravity=tuple(self.scene.gravity))
        p = world.integration_parameters
        p.dt = self.h
        p.num_solver_iterations = settings["iterations"]
        p.num_internal_pgs_iterations = settings["internal"]
        p.num_internal_stabilization_iterations = settings["stabilization"]
        # Ground that cannot move has a spring of its own.
        p.contact_softness = rapier.SpringCoefficients(settings["frequency"], settings["damping"])
        p.static_contact_softness = rapier.SpringCoefficients(settings["frequency"], settings["damping"])
        p.normalized_allowed_linear_error = settings["slop"]
        p.normalized_prediction_distance = settings["prediction"]
        p.friction_model = getattr(rapier.FrictionModel, settings["friction"])
        p.friction_in_bias_pass = settings["biased"]
        p.normalized_max_linear_velocity = FAST
        p.contact_recycling = False
        p.contact_clustering = False

        box, spheres, frame, point = shapes(self.scene, settings["boxes"])
        collider = rapier.Collider

        def rough(builder):
            # Both shapes have both coefficients, and Rapier takes their mean.
            return builder.density(0.0).friction(self.scene.friction).restitution(self.scene.restitution)

        world.add_collider(rough(collider.halfspace(tuple(frame[:, 2])).translation(tuple(point))))
        if box is not None:
            place = rapier.Isometry3(tuple(box.centre), rapier.Rotation3(*from_matrix(box.axes)))
            parts = [rough(collider.cuboid(*box.half).position(place))]
        else:
            parts = [rough(collider.ball(radius).translation(tuple(centre))) for *centre, radius in spheres]
        mass = rapier.MassProperties((0.0, 0.0, 0.0), body.m, tuple(body.principal_J))
        handle = world.add_body(
            rapier.RigidBody.dynamic()
            .position(rapier.Isometry3(tuple(row[:3]), rapier.Rotation3(*row[3:7])))
            .linvel(tuple(row[7:10]))
            .angvel(tuple(to_matrix(row[3:7]) @ row[10:]))
            .additional_mass_properties(mass)
            .gyroscopic_forces(True)
            .allow_fast_rotation(True)
            .can_sleep(False)
            .ccd_enabled(settings["ccd"]),
            parts,
        )
        self.body = world.rigid_bodies[handle]

    def go(self, n, torque):
        step = self.world.step
        if torque is None:
            for _ in range(n):
                step()
            return
        body = self.body
        for _ in range(n):  # it holds a torque in world axes
            body.reset_torques()
            body.add_torque(body.rotation.transform_point(torque))
            step()

    def row(self):
        if not self.body.is_enabled:
            raise EngineError("Rapier has put the body into quarantine: its state is no longer finite")
        x, turn, v, w = self.body.translation, self.body.rotation, self.body.linvel, self.body.angvel
        quat = np.array([turn.w, turn.i, turn.j, turn.k])
        w_b = to_matrix(quat).T @ [w.x, w.y, w.z]
        return np.concatenate([[x.x, x.y, x.z], quat, [v.x, v.y, v.z], w_b])
