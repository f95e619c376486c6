"""PyBullet: Bullet's sequential impulses."""

from typing import Any, ClassVar

import numpy as np

from solver.chart.engine import EngineError
from solver.chart.peers.peer import Peer
from solver.chart.peers.shapes import shapes
from solver.rotation import from_matrix, to_matrix
from solver.scene import Scene

FAST = 1e9
"""m/s, rad/s: where it clamps joint velocities, out of the way."""


class PyBullet(Peer):
    """Bullet through PyBullet, without a server.

    Args:
        iterations: of the sequential impulses, a step.
        residual: where they stop early.
        erp: what share of an overlap a step takes out.
        slop: the overlap that is left alone, m.
        breaking: how far ahead contacts are made and kept, m; a far one takes the speed that would bounce.
        split: take overlaps out by velocities that do not stay (`useSplitImpulse`); only if `maximal`.
        bounce_above: approach speed below which nothing bounces, m/s.
        maximal: a `btRigidBody` in place of a `btMultiBody` of one link.
        cone: friction as a cone in place of a pyramid; only if not `maximal`.
        boxes: a box where the hull is one, otherwise spheres at its corners.
    """

    name = "PyBullet"
    package = module = "pybullet"
    note = (
        "restitution is Newton's, by the speed at a step's start; an impact between two steps is not sought"
    )
    defaults: ClassVar[dict[str, Any]] = {
        "iterations": 50,
        "residual": 0.0,
        "erp": 0.2,
        "slop": 0.0,
        "breaking": 1e-4,
        "split": True,
        "bounce_above": 0.0,
        "maximal": True,
        "cone": True,
        "boxes": False,
    }

    def world(self, scene: Scene, h: float) -> "_World":
        """The scene in a client of its own."""
        return _World(scene, h, self.settings)


class _World:
    def __init__(self, scene: Scene, h: float, settings: dict[str, Any]):
        import pybullet

        self.bullet, self.error = pybullet, pybullet.error
        self.client = pybullet.connect(pybullet.DIRECT)
        self.scene, self.h, self.settings = scene, h, settings

    def __del__(self):
        self.bullet.disconnect(self.client)

    def put(self, row):
        bullet, client, settings, body = self.bullet, self.client, self.settings, self.scene.body
        bullet.resetSimulation(physicsClientId=client)
        bullet.setGravity(*self.scene.gravity, physicsClientId=client)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.h,
            numSolverIterations=settings["iterations"],
            solverResidualThreshold=settings["residual"],
            erp=settings["erp"],
            contactERP=settings["erp"],
            contactSlop=settings["slop"],
            contactBreakingThreshold=settings["breaking"],
            useSplitImpulse=int(settings["split"]),
            splitImpulsePenetrationThreshold=0.0,
            restitutionVelocityThreshold=settings["bounce_above"],
            enableConeFriction=int(settings["cone"]),
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        box, spheres, frame, point = shapes(self.scene, settings["boxes"])
        plane = bullet.createCollisionShape(
            bullet.GEOM_PLANE, planeNormal=frame[:, 2], physicsClientId=client
        )
        kind = {"useMaximalCoordinates": int(settings["maximal"]), "physicsClientId": client}
        ground = bullet.createMultiBody(0.0, plane, basePosition=point, **kind)
        if box is not None:
            shape = bullet.createCollisionShape(
                bullet.GEOM_BOX,
                halfExtents=box.half,
                collisionFramePosition=box.centre,
                collisionFrameOrientation=_xyzw(from_matrix(box.axes)),
                physicsClientId=client,
            )
        else:
            shape = bullet.createCollisionShapeArray(
                shapeTypes=[bullet.GEOM_SPHERE] * len(spheres),
                radii=spheres[:, 3].tolist(),
                collisionFramePositions=spheres[:, :3].tolist(),
                physicsClientId=client,
            )
        self.body = bullet.createMultiBody(
            body.m, shape, basePosition=row[:3], baseOrientation=_xyzw(row[3:7]), **kind
        )
        law = {"rollingFriction": 0.0, "spinningFriction": 0.0, "physicsClientId": client}
        # Bullet multiplies the pair's coefficients.
        bullet.changeDynamics(ground, -1, lateralFriction=1.0, restitution=1.0, **law)
        bullet.changeDynamics(
            self.body,
            -1,
            lateralFriction=self.scene.friction,
            restitution=self.scene.restitution,
            mass=body.m,
            localInertiaDiagonal=body.principal_J,
            linearDamping=0.0,
            angularDamping=0.0,
            maxJointVelocity=FAST,
            activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            **law,
        )
        bullet.resetBaseVelocity(self.body, row[7:10], to_matrix(row[3:7]) @ row[10:], physicsClientId=client)

    def go(self, n, torque):
        step, client = self.bullet.stepSimulation, self.client
        try:
            if torque is None:
                for _ in range(n):
                    step(physicsClientId=client)
                return
            push, frame, body = self.bullet.applyExternalTorque, self.bullet.LINK_FRAME, self.body
            for _ in range(n):  # it forgets the torque after each step
                push(body, -1, torque, frame, physicsClientId=client)
                step(physicsClientId=client)
        except self.error as error:
            raise EngineError(f"PyBullet: {error}") from error

    def row(self):
        x, xyzw = self.bullet.getBasePositionAndOrientation(self.body, physicsClientId=self.client)
        v, w = self.bullet.getBaseVelocity(self.body, physicsClientId=self.client)
        quat = np.array([xyzw[3], *xyzw[:3]])
        return np.concatenate([x, quat, v, to_matrix(quat).T @ w])


def _xyzw(quat: np.ndarray) -> np.ndarray:
    """Bullet's order of a quaternion."""
    return np.roll(quat, -1)
