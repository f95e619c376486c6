"""Quaternions (w, x, y, z; body to world) on arrays with any leading axes."""

import numpy as np
from numpy.typing import ArrayLike


def to_matrix(quat: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4): world = R body."""
    w, x, y, z = np.moveaxis(np.asarray(quat, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,), w >= 0, of one rotation matrix (3, 3)."""
    # The largest of the four squares is safe to divide by.
    squares = np.array(
        [
            1 + R[0, 0] + R[1, 1] + R[2, 2],
            1 + R[0, 0] - R[1, 1] - R[2, 2],
            1 - R[0, 0] + R[1, 1] - R[2, 2],
            1 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, f = R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2]
    columns = [
        [squares[0], a, b, c],
        [a, squares[1], d, e],
        [b, d, squares[2], f],
        [c, e, f, squares[3]],
    ]
    quat = np.array(columns[int(squares.argmax())])
    quat /= np.linalg.norm(quat)
    return quat if quat[0] >= 0 else -quat


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a ⊗ b: first turn by b, then by a. (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        -1,
    )


def from_vector(vector: ArrayLike) -> np.ndarray:
    """Unit quaternions (..., 4) of turns by |vector| rad about vectors (..., 3)."""
    vector = np.asarray(vector, dtype=np.float64)
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vector], -1)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between attitudes (..., 4), rad: 4 atan2(|a - b|, |a + b|), a and -a being one; 0 between equals."""
    less, more = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return 4.0 * np.arctan2(np.minimum(less, more), np.maximum(less, more))
