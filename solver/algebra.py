"""Vectors, quaternions and rotation matrices as tuples of scalars, for numba kernels.

A vector is (a0, a1, a2); a quaternion is (w, x, y, z), body to world; a matrix is nine scalars, row
by row. Tuples live in registers: `np.cross` and `np.dot` on 3-vectors are about thirty times slower.
"""

from numba import njit, types
from numba.core import cgutils, config
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

from .trace import fma, sqrt, traced

# No liberties for the compiler (fastmath): the same formula has the same bits wherever it is compiled,
# whatever surrounds it, on any processor. Where multiplying and adding in one pays, `fma` says so.
_HELPER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}


class _Inner(Dispatcher):
    """A function for kernels, without the code that lets Python call it: a third of its compiling.

    Python can call it all the same, through a kernel that is made when it first does.
    """

    def __call__(self, *args):
        if not hasattr(self, "_outer"):
            inner = self
            self._outer = njit(lambda *args: inner(*args))
        return self._outer(*args)


def _inner(function, **how):
    dispatcher = njit(**_HELPER, **how)(function)
    if not config.DISABLE_JIT:
        dispatcher.__class__ = _Inner
    return dispatcher


def jit(function):
    """For small helpers with branches or loops: they dissolve in their caller.

    Left to itself the compiler calls most of them, passing each array as nine arguments, which costs more
    than what they do.
    """
    return _inner(function, forceinline=True)


def stage(function):
    """For the stages of a step: called, not copied, which keeps compiling quick."""
    return _inner(function, forceinline=False)  # or it would inherit that from a helper that calls it


def entry(function):
    """For the few functions that Python calls: compiled once, then kept on disk.

    Numba keeps them beside the source, or in the user's own cache where that can't be written to. Where
    neither can, they are compiled anew in each process.
    """
    how = {"error_model": "numpy", "nogil": True}
    try:
        return njit(cache=True, **how)(function)
    except RuntimeError:
        return njit(**how)(function)


@traced
def dot(a, b):
    """a · b."""
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


@traced
def cross(a, b):
    """a × b."""
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )


@traced
def add(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@traced
def axpy(s, a, b):
    """s a + b."""
    return (fma(s, a[0], b[0]), fma(s, a[1], b[1]), fma(s, a[2], b[2]))


@traced
def scale(s, a):
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@traced
def times(a, b):
    """Component by component: a diagonal matrix, held as a vector, times a vector."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


# Arrays are read by index, never through views: a view costs two atomic reference counts.
@traced
def vec(array, at):
    """Three consecutive entries of a 1-D array."""
    return (array[at], array[at + 1], array[at + 2])


if config.DISABLE_JIT:

    def apart():
        """Nothing."""

else:

    @intrinsic
    def apart(typingctx):
        """Keep the function that calls this from being copied into its callers, by LLVM either."""

        def codegen(context, builder, signature, args):
            builder.function.attributes.add("noinline")
            return context.get_dummy_value()

        return types.none(), codegen


if config.DISABLE_JIT:

    def borrowed(array):
        """The array itself."""
        return array

    def keep_alive(*arrays):
        """Nothing."""
else:

    @intrinsic
    def borrowed(typingctx, array):
        """The array without its reference count, for as long as the caller holds it.

        Otherwise every call of a stage counts every array up and down, by locked instructions that
        cost as much as a contact. A function that lends out an array of its own must `keep_alive` it to
        its end: numba frees a variable after its last use.
        """

        def codegen(context, builder, signature, args):
            view = context.make_array(signature.args[0])(context, builder, value=args[0])
            view.meminfo = cgutils.get_null_value(view.meminfo.type)
            return view._getvalue()

        return array(array), codegen

    @intrinsic
    def keep_alive(typingctx, *arrays):
        """The last use of arrays: they live until here, and so does what is `borrowed` of them."""

        def codegen(context, builder, signature, args):
            return context.get_dummy_value()

        return types.none(types.StarArgTuple(arrays)), codegen


# A tuple is never indexed by a loop variable: that is a chain of branches, not a load.
@traced
def put(array, at, a):
    """Store a vector in three consecutive entries of a 1-D array."""
    array[at] = a[0]
    array[at + 1] = a[1]
    array[at + 2] = a[2]


@traced
def put_quat(array, at, quat):
    """Store a quaternion in four consecutive entries of a 1-D array."""
    put(array, at, (quat[0], quat[1], quat[2]))
    array[at + 3] = quat[3]


@traced
def vec2(array, k, at):
    """Three consecutive entries of row k of a 2-D array."""
    return (array[k, at], array[k, at + 1], array[k, at + 2])


@traced
def six2(array, k, at):
    """Six consecutive entries of row k of a 2-D array."""
    return (
        array[k, at], array[k, at + 1], array[k, at + 2],
        array[k, at + 3], array[k, at + 4], array[k, at + 5],
    )  # fmt: skip


@traced
def put2(array, k, at, a):
    """Store a vector in three consecutive entries of row k of a 2-D array."""
    array[k, at] = a[0]
    array[k, at + 1] = a[1]
    array[k, at + 2] = a[2]


@traced
def put6(array, k, at, a):
    """Store six numbers in consecutive entries of row k of a 2-D array."""
    put2(array, k, at, (a[0], a[1], a[2]))
    put2(array, k, at + 3, (a[3], a[4], a[5]))


@traced
def matrix(quat):
    """Rotation matrix R of a unit quaternion: world = R body."""
    w, x, y, z = quat
    return (
        fma(-2.0, fma(y, y, z * z), 1.0), 2.0 * fma(x, y, -(w * z)), 2.0 * fma(x, z, w * y),
        2.0 * fma(x, y, w * z), fma(-2.0, fma(x, x, z * z), 1.0), 2.0 * fma(y, z, -(w * x)),
        2.0 * fma(x, z, -(w * y)), 2.0 * fma(y, z, w * x), fma(-2.0, fma(x, x, y * y), 1.0),
    )  # fmt: skip


@traced
def to_world(R, a):
    """R a."""
    return (
        fma(R[2], a[2], fma(R[1], a[1], R[0] * a[0])),
        fma(R[5], a[2], fma(R[4], a[1], R[3] * a[0])),
        fma(R[8], a[2], fma(R[7], a[1], R[6] * a[0])),
    )


@traced
def to_body(R, a):
    """Rᵀ a."""
    return (
        fma(R[6], a[2], fma(R[3], a[1], R[0] * a[0])),
        fma(R[7], a[2], fma(R[4], a[1], R[1] * a[0])),
        fma(R[8], a[2], fma(R[5], a[1], R[2] * a[0])),
    )


@traced
def product(a, b):
    """The quaternion product a b: the attitude b, then a."""
    return (
        fma(-a[3], b[3], fma(-a[2], b[2], fma(-a[1], b[1], a[0] * b[0]))),
        fma(-a[3], b[2], fma(a[2], b[3], fma(a[0], b[1], a[1] * b[0]))),
        fma(-a[1], b[3], fma(a[3], b[1], fma(a[0], b[2], a[2] * b[0]))),
        fma(-a[2], b[1], fma(a[1], b[2], fma(a[0], b[3], a[3] * b[0]))),
    )


@traced
def turned(quat, e):
    """The attitude `quat`, then turned by 2 arctan|e| about the body axis e (Cayley), renormalised.

    e in body axes. The result's norm is 1 to rounding, whatever the norm of `quat` had drifted to.
    """
    w, x, y, z = product(quat, (1.0, e[0], e[1], e[2]))
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (w * s, x * s, y * s, z * s)
