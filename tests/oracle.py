"""Slow and obvious: the equations in numpy, sharing nothing with the kernels."""

import numpy as np


def turned(axis, angle):
    """Quaternion of a turn about an axis."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])


def rotation(quat):
    w, x, y, z = quat
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


class Article:
    """Eqs. 1-8 at one hull point of a body, in world axes, with 6 x 6 matrices as they stand."""

    def __init__(self, scene, x, quat, v_com, w, k=0, force=(0, 0, 0), torque_b=(0, 0, 0)):
        body = scene.body
        N = np.asarray(scene.surface.normal)
        R = rotation(quat)
        J = R @ body.J @ R.T
        b = R @ body.hull[k]
        q = b - body.radius[k] * N
        self.M = np.block([[body.m * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), J]])
        self.W = np.concatenate([N, np.cross(q, N)])
        self.F = np.concatenate(
            [
                body.m * np.asarray(scene.gravity) + np.asarray(force, float),
                R @ np.asarray(torque_b, float) - np.cross(w, J @ w),
            ]
        )
        c = N @ np.cross(w, np.cross(w, b))
        self.G = self.W @ np.linalg.solve(self.M, self.W)
        self.l = self.W @ np.linalg.solve(self.M, self.F) + c
        self.v = self.W @ np.concatenate([v_com, w])
        self.f = max(0.0, -self.l / self.G)
        self.i = max(0.0, -(1 + scene.restitution) * self.v / self.G)
        self.gap = N @ (x + b - scene.surface.point) - body.radius[k]

    def acceleration(self, f):
        """Eq. 3 for a: (ẍ, ẇ), world axes."""
        return np.linalg.solve(self.M, self.F + self.W * f)

    def jump(self, i):
        """Change of (ẋ, w) by an impulse, world axes."""
        return np.linalg.solve(self.M, self.W * i)


def random_quat(rng):
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)


def random_body(rng, points=1):
    """Any real body: its inertia is that of a few random masses, so not diagonal."""
    from solver import Body

    r = rng.normal(size=(6, 3)) * rng.uniform(0.1, 2.0, 3)
    m = rng.uniform(0.1, 1.0, 6)
    r -= (m @ r) / m.sum()
    J = sum(mi * (ri @ ri * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m, r, strict=True))
    hull = rng.normal(size=(points, 3))
    return Body(m.sum(), J, hull, radius=rng.choice([0.0, 0.1]))


def touching(scene, quat, along=(0.0, 0.0)):
    """x such that the deepest hull point exactly touches the plane."""
    from solver import State

    zero = np.zeros(3)
    N = scene.surface.normal
    x = np.asarray(scene.surface.point) + 0.0
    gap = scene.gap(State(x, quat, zero, zero)).min()
    return x - gap * N
