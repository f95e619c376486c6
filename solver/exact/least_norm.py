"""The least-norm solution of a small linear system that may be singular."""

from math import sqrt

from ..algebra import stage

RANK = 1e-10
"""Of the largest singular value: smaller ones count as zero. Constraints that a rigid body can't tell
apart leave 1e-16, others 1e-4 and more."""

MAX_SWEEPS = 30


@stage
def least_norm(B, n, r, Q, x):
    """x of least norm among those that come nearest to B x = r: by B's singular values.

    One-sided Jacobi (Hestenes, J. SIAM 6:51, 1958): columns are turned pair by pair until they are
    orthogonal.

    Args:
        B: at least (n, n); destroyed.
        n: size.
        r: (n,).
        Q: at least (n, n) scratch.
        x: (n,) filled.
    """
    if n == 1:
        x[0] = r[0] / B[0, 0]
        return
    for i in range(n):
        for j in range(n):
            Q[i, j] = 1.0 if i == j else 0.0
    for _ in range(MAX_SWEEPS):
        done = True
        for i in range(n - 1):
            for j in range(i + 1, n):
                ii, ij, jj = 0.0, 0.0, 0.0
                for k in range(n):
                    ii += B[k, i] * B[k, i]
                    ij += B[k, i] * B[k, j]
                    jj += B[k, j] * B[k, j]
                if abs(ij) <= 1e-16 * sqrt(ii * jj):
                    continue
                done = False
                zeta = (jj - ii) / (2.0 * ij)
                t = 1.0 / (abs(zeta) + sqrt(1.0 + zeta * zeta))
                t = -t if zeta < 0.0 else t
                c = 1.0 / sqrt(1.0 + t * t)
                s = c * t
                for k in range(n):
                    B[k, i], B[k, j] = c * B[k, i] - s * B[k, j], s * B[k, i] + c * B[k, j]
                    Q[k, i], Q[k, j] = c * Q[k, i] - s * Q[k, j], s * Q[k, i] + c * Q[k, j]
        if done:
            break
    largest = 0.0
    for i in range(n):
        square = 0.0
        for k in range(n):
            square += B[k, i] * B[k, i]
        largest = max(largest, square)
        x[i] = 0.0
    for i in range(n):
        square, along = 0.0, 0.0
        for k in range(n):
            square += B[k, i] * B[k, i]
            along += B[k, i] * r[k]
        if square > RANK * RANK * largest:
            for k in range(n):
                x[k] += Q[k, i] * along / square
