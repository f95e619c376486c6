"""Vectors, quaternions and rotation matrices as tuples of scalars, for numba kernels.

A vector is (a0, a1, a2); a quaternion is (w, x, y, z), body to world; a matrix is nine scalars, row
by row. Tuples live in registers: `np.cross` and `np.dot` on 3-vectors are about thirty times slower.
"""

from functools import partial
from math import sqrt

from numba import njit, types
from numba.core import cgutils, config
from numba.extending import intrinsic

# No liberties for the compiler (fastmath): the same formula has the same bits wherever it is compiled,
# whatever surrounds it, on any processor. Where multiplying and adding in one pays, `fma` says so.
jit = partial(njit, error_model="numpy", forceinline=True, no_cfunc_wrapper=True)
"""For small helpers: they dissolve in their caller. Left to itself the compiler calls most of them,
passing each array as nine arguments, which costs more than what they do."""
stage = partial(njit, error_model="numpy", no_cfunc_wrapper=True)
"""For the stages of a step: called, not copied, which keeps compiling quick."""
once = partial(njit, error_model="numpy", inline="always")
"""For what has one caller or two, and is large: not compiled by itself first."""
entry = partial(njit, error_model="numpy", cache=True, nogil=True)
"""For the few functions that Python calls: compiled once, then kept on disk."""


if config.DISABLE_JIT:

    def fma(a, b, c):
        """a b + c, rounded twice here."""
        return a * b + c
else:

    @intrinsic
    def fma(typingctx, a, b, c):
        """a b + c, rounded once."""

        def codegen(context, builder, signature, args):
            return builder.fma(*args)

        return types.float64(types.float64, types.float64, types.float64), codegen


@jit
def dot(a, b):
    """a · b."""
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


@jit
def cross(a, b):
    """a × b."""
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )


@jit
def add(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@jit
def axpy(s, a, b):
    """s a + b."""
    return (fma(s, a[0], b[0]), fma(s, a[1], b[1]), fma(s, a[2], b[2]))


@jit
def scale(s, a):
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@jit
def times(a, b):
    """Component by component: a diagonal matrix, held as a vector, times a vector."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


# Arrays are read by index, never through views: a view costs two atomic reference counts.
@jit
def vec(array, at):
    """Three consecutive entries of a 1-D array."""
    return (array[at], array[at + 1], array[at + 2])


if config.DISABLE_JIT:

    def borrowed(array):
        """The array itself."""
        return array
else:

    @intrinsic
    def borrowed(typingctx, array):
        """The array without its reference count, for as long as the caller holds it.

        Otherwise every call of a stage counts every array up and down, by locked instructions that
        cost as much as a contact.
        """

        def codegen(context, builder, signature, args):
            view = context.make_array(signature.args[0])(context, builder, value=args[0])
            view.meminfo = cgutils.get_null_value(view.meminfo.type)
            return view._getvalue()

        return array(array), codegen


# A tuple is never indexed by a loop variable: that is a chain of branches, not a load.
@jit
def put(array, at, a):
    """Store a vector in three consecutive entries of a 1-D array."""
    array[at] = a[0]
    array[at + 1] = a[1]
    array[at + 2] = a[2]


@jit
def put_quat(array, at, quat):
    """Store a quaternion in four consecutive entries of a 1-D array."""
    put(array, at, (quat[0], quat[1], quat[2]))
    array[at + 3] = quat[3]


@jit
def vec2(array, k, at):
    """Three consecutive entries of row k of a 2-D array."""
    return (array[k, at], array[k, at + 1], array[k, at + 2])


@jit
def six2(array, k, at):
    """Six consecutive entries of row k of a 2-D array."""
    return (
        array[k, at], array[k, at + 1], array[k, at + 2],
        array[k, at + 3], array[k, at + 4], array[k, at + 5],
    )  # fmt: skip


@jit
def put2(array, k, at, a):
    """Store a vector in three consecutive entries of row k of a 2-D array."""
    array[k, at] = a[0]
    array[k, at + 1] = a[1]
    array[k, at + 2] = a[2]


@jit
def put6(array, k, at, a):
    """Store six numbers in consecutive entries of row k of a 2-D array."""
    put2(array, k, at, (a[0], a[1], a[2]))
    put2(array, k, at + 3, (a[3], a[4], a[5]))


@jit
def matrix(quat):
    """Rotation matrix R of a unit quaternion: world = R body."""
    w, x, y, z = quat
    return (
        fma(-2.0, fma(y, y, z * z), 1.0), 2.0 * fma(x, y, -(w * z)), 2.0 * fma(x, z, w * y),
        2.0 * fma(x, y, w * z), fma(-2.0, fma(x, x, z * z), 1.0), 2.0 * fma(y, z, -(w * x)),
        2.0 * fma(x, z, -(w * y)), 2.0 * fma(y, z, w * x), fma(-2.0, fma(x, x, y * y), 1.0),
    )  # fmt: skip


@jit
def to_world(R, a):
    """R a."""
    return (
        fma(R[2], a[2], fma(R[1], a[1], R[0] * a[0])),
        fma(R[5], a[2], fma(R[4], a[1], R[3] * a[0])),
        fma(R[8], a[2], fma(R[7], a[1], R[6] * a[0])),
    )


@jit
def to_body(R, a):
    """Rᵀ a."""
    return (
        fma(R[6], a[2], fma(R[3], a[1], R[0] * a[0])),
        fma(R[7], a[2], fma(R[4], a[1], R[1] * a[0])),
        fma(R[8], a[2], fma(R[5], a[1], R[2] * a[0])),
    )


@jit
def product(a, b):
    """The quaternion product a b: the attitude b, then a."""
    return (
        fma(-a[3], b[3], fma(-a[2], b[2], fma(-a[1], b[1], a[0] * b[0]))),
        fma(-a[3], b[2], fma(a[2], b[3], fma(a[0], b[1], a[1] * b[0]))),
        fma(-a[1], b[3], fma(a[3], b[1], fma(a[0], b[2], a[2] * b[0]))),
        fma(-a[2], b[1], fma(a[1], b[2], fma(a[0], b[3], a[3] * b[0]))),
    )


@jit
def turned(quat, e):
    """The attitude `quat`, then turned by 2 arctan|e| about the body axis e (Cayley), renormalised.

    e in body axes. The result's norm is 1 to rounding, whatever the norm of `quat` had drifted to.
    """
    w, x, y, z = product(quat, (1.0, e[0], e[1], e[2]))
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (w * s, x * s, y * s, z * s)
