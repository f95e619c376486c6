"""Straight-line arithmetic written once: for a number, and for a number of many bodies at once.

`traced` turns a plain function without data-dependent branches into one that numba's kernels call. Where
a kernel is compiled, the function itself is run, on stand-ins for numbers which write down in LLVM's
language what is done to them. So it has no typing and no compilation of its own (each would take about a
tenth of a second, and there are a hundred such functions), and it takes whatever numbers it is given:
float64, float32, or `Lanes` of either, a vector register with one number for each of several bodies. What
is done to a lane is, to the bit, what would be done to the number alone.

Branches become `where`, whose two sides are both computed; `if x is None` is decided as it is traced.
"""

import inspect
import operator
from functools import update_wrapper

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.core.datamodel import models, register_default
from numba.core.extending import _Intrinsic
from numba.core.imputils import lower_builtin
from numba.core.registry import cpu_target
from numba.core.typing.templates import AbstractTemplate, infer_global

WIDTH = {types.float64: 8, types.float32: 16}
"""Lanes of each kind: what a 512-bit register holds; on smaller ones LLVM takes several."""

LANES = WIDTH[types.float64]


class Lanes(types.Type):
    """One number for each of several bodies: a vector register.

    Args:
        dtype: of the numbers.
    """

    def __init__(self, dtype):
        self.dtype = dtype
        self.width = WIDTH[dtype]
        super().__init__(f"Lanes({dtype})")


class Mask(types.Type):
    """Yes or no for each of several bodies.

    Args:
        width: how many.
    """

    def __init__(self, width):
        self.width = width
        super().__init__(f"Mask({width})")


@register_default(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes):
        element = ir.DoubleType() if lanes.dtype == types.float64 else ir.FloatType()
        super().__init__(manager, lanes, ir.VectorType(element, lanes.width))


@register_default(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, mask):
        super().__init__(manager, mask, ir.VectorType(ir.IntType(1), mask.width))


def _is_float(kind):
    return isinstance(kind, types.Float | Lanes)


def _is_truth(kind):
    return isinstance(kind, types.Boolean | Mask)


class _Tracer:
    """Where stand-ins write to."""

    def __init__(self, context, builder):
        self.context, self.builder = context, builder

    def enter(self, kind, value):
        """The stand-in for an LLVM value of a numba type."""
        if isinstance(kind, types.NoneType):
            return None
        if isinstance(kind, types.BaseTuple):
            parts = cgutils.unpack_tuple(self.builder, value, kind.count)
            return tuple(self.enter(k, v) for k, v in zip(kind.types, parts, strict=True))
        if isinstance(kind, types.Array):
            return _Array(self, kind, value)
        if isinstance(kind, types.Literal):
            kind = kind.literal_type
        return Number(self, kind, value)

    def leave(self, result):
        """(numba type, LLVM value) of what a function returned."""
        if result is None:
            return types.none, self.context.get_dummy_value()
        if isinstance(result, tuple):
            parts = [self.leave(part) for part in result]
            kind = types.BaseTuple.from_types([k for k, _ in parts])
            return kind, self.context.make_tuple(self.builder, kind, [v for _, v in parts])
        if isinstance(result, _Array):
            return result.kind, result.value
        number = self.number(result)
        return number.kind, number.value

    def number(self, x, like=None):
        """x as a Number, converted to the type of `like`."""
        if not isinstance(x, Number):
            if isinstance(x, bool):
                x = Number(self, types.boolean, ir.Constant(ir.IntType(1), x))
            elif isinstance(x, int) and (like is None or isinstance(like.kind, types.Integer)):
                x = Number(self, types.int64, ir.Constant(ir.IntType(64), int(x)))
            else:
                kind = types.float64
                if like is not None and _is_float(like.kind):
                    kind = getattr(like.kind, "dtype", like.kind)
                x = Number(self, kind, ir.Constant(self.context.get_value_type(kind), float(x)))
        return x if like is None else self.convert(x, like.kind)

    def convert(self, x, kind):
        """A number of another type: widened, or the same in every lane."""
        if x.kind == kind:
            return x
        if isinstance(kind, Lanes | Mask) and not isinstance(x.kind, Lanes | Mask):
            x = self.convert(x, kind.dtype if isinstance(kind, Lanes) else types.boolean)
            vector = self.context.get_value_type(kind)
            value = self.builder.insert_element(
                ir.Constant(vector, ir.Undefined), x.value, ir.Constant(ir.IntType(32), 0)
            )
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), kind.width), None)
            return Number(
                self, kind, self.builder.shuffle_vector(value, ir.Constant(vector, ir.Undefined), zeros)
            )
        return Number(self, kind, self.context.cast(self.builder, x.value, x.kind, kind))

    def alike(self, *numbers):
        """The numbers in the widest type among them."""
        kinds = [x.kind for x in numbers if isinstance(x, Number)]
        if any(isinstance(x, float) for x in numbers) and not any(map(_is_float, kinds)):
            kinds.append(types.float64)
        kind = max(kinds, key=_rank)
        like = Number(self, kind, None)
        return [self.number(x, like) for x in numbers]

    def call(self, name, x, *more):
        """An LLVM intrinsic of operands of one type."""
        values = [x.value, *(y.value for y in more)]
        kind = values[0].type
        of = {ir.DoubleType: "f64", ir.FloatType: "f32"}
        vector = isinstance(kind, ir.VectorType)
        suffix = f"v{kind.count}{of[type(kind.element)]}" if vector else of[type(kind)]
        function = cgutils.get_or_insert_function(
            self.builder.module, ir.FunctionType(kind, [kind] * len(values)), f"llvm.{name}.{suffix}"
        )
        return Number(self, x.kind, self.builder.call(function, values))


def _rank(kind):
    """The order in which types give way to one another."""
    if isinstance(kind, Lanes | Mask):
        return 4
    return [types.Boolean, types.Integer, types.Float].index(
        next(k for k in (types.Boolean, types.Integer, types.Float) if isinstance(kind, k))
    ) + (0.5 if kind == types.float64 else 0.0)


class Number:
    """A stand-in for a number, or for one in each lane."""

    __slots__ = ("kind", "tracer", "value")

    def __init__(self, tracer, kind, value):
        self.tracer, self.kind, self.value = tracer, kind, value

    def _with(self, other, for_floats, for_integers):
        a, b = self.tracer.alike(self, other)
        method = for_floats if _is_float(a.kind) else for_integers
        return Number(self.tracer, a.kind, getattr(self.tracer.builder, method)(a.value, b.value))

    def __add__(self, other):
        return self._with(other, "fadd", "add")

    def __sub__(self, other):
        return self._with(other, "fsub", "sub")

    def __mul__(self, other):
        return self._with(other, "fmul", "mul")

    def __radd__(self, other):
        return self.tracer.number(other) + self

    def __rsub__(self, other):
        return self.tracer.number(other) - self

    def __rmul__(self, other):
        return self.tracer.number(other) * self

    def __truediv__(self, other):
        return self._with(other, "fdiv", "no division of integers")

    def __rtruediv__(self, other):
        return self.tracer.number(other) / self

    def __neg__(self):
        builder = self.tracer.builder
        return Number(
            self.tracer, self.kind, (builder.fneg if _is_float(self.kind) else builder.neg)(self.value)
        )

    def __abs__(self):
        return self.tracer.call("fabs", self)

    def _compare(self, operator, other):
        a, b = self.tracer.alike(self, other)
        builder = self.tracer.builder
        if not _is_float(a.kind):
            compare = builder.icmp_signed
        else:
            compare = builder.fcmp_unordered if operator == "!=" else builder.fcmp_ordered
        kind = Mask(a.kind.width) if isinstance(a.kind, Lanes) else types.boolean
        return Number(self.tracer, kind, compare(operator, a.value, b.value))

    def __lt__(self, other):
        return self._compare("<", other)

    def __le__(self, other):
        return self._compare("<=", other)

    def __gt__(self, other):
        return self._compare(">", other)

    def __ge__(self, other):
        return self._compare(">=", other)

    def __eq__(self, other):
        return self._compare("==", other)

    def __ne__(self, other):
        return self._compare("!=", other)

    __hash__ = None  # type: ignore[assignment]

    def __and__(self, other):
        return self._with(other, "and_", "and_")

    def __or__(self, other):
        return self._with(other, "or_", "or_")

    def __invert__(self):
        return Number(self.tracer, self.kind, self.tracer.builder.not_(self.value))

    __rand__, __ror__ = __and__, __or__

    def __bool__(self):
        raise TypeError("a traced function can't branch on a number: use `where`")


class _Array:
    """A stand-in for an array. With one index fewer than dimensions, the last is that of the lanes."""

    def __init__(self, tracer, kind, value):
        self.tracer, self.kind, self.value = tracer, kind, value
        self.struct = tracer.context.make_array(kind)(tracer.context, tracer.builder, value)

    def _place(self, index):
        index = index if isinstance(index, tuple) else (index,)
        tracer = self.tracer
        kind = self.kind.dtype
        if len(index) == self.kind.ndim - 1:
            kind = Lanes(kind)
            index = (*index, 0)
        at = [tracer.number(i, Number(tracer, types.intp, None)).value for i in index]
        pointer = cgutils.get_item_pointer(tracer.context, tracer.builder, self.kind, self.struct, at)
        return kind, pointer

    def __getitem__(self, index):
        kind, pointer = self._place(index)
        tracer = self.tracer
        if isinstance(kind, Lanes):
            vector = tracer.context.get_value_type(kind)
            pointer = tracer.builder.bitcast(pointer, vector.as_pointer())
            value = tracer.builder.load(pointer)
            value.align = 8
            return Number(tracer, kind, value)
        return Number(tracer, kind, tracer.context.unpack_value(tracer.builder, kind, pointer))

    def __setitem__(self, index, x):
        kind, pointer = self._place(index)
        tracer = self.tracer
        x = tracer.number(x, Number(tracer, kind, None))
        if isinstance(kind, Lanes):
            pointer = tracer.builder.bitcast(pointer, x.value.type.as_pointer())
            tracer.builder.store(x.value, pointer).align = 8
        else:
            tracer.context.pack_value(tracer.builder, kind, x.value, pointer)


class _Traced(_Intrinsic):  # type: ignore[misc]
    """What `traced` makes of a function. Python may call it, too: then it is the function itself."""

    def __call__(self, *args):
        return self.__wrapped__(*args)


def _emit(function, context, builder, kinds, values):
    tracer = _Tracer(context, builder)
    return tracer.leave(function(*(tracer.enter(k, v) for k, v in zip(kinds, values, strict=True))))


def _tried(function, kinds):
    """(type of what a function returns, LLVM block): it is traced for nothing."""
    context = cpu_target.target_context
    block = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), []), "trial").append_basic_block()
    values = [ir.Constant(context.get_value_type(kind), ir.Undefined) for kind in kinds]
    return _emit(function, context, ir.IRBuilder(block), kinds, values)[0], block


def flops(function, *kinds):
    """How many floating-point operations a traced function is for arguments of these numba types.

    Multiplying and adding in one are two, a division or a root is one; comparing, choosing and changing
    signs are none.
    """
    count = 0
    for instruction in _tried(function, kinds)[1].instructions:
        if isinstance(instruction, ir.CallInstr):
            name = instruction.callee.name
            count += 2 * name.startswith("llvm.fma") + name.startswith("llvm.sqrt")
        else:
            count += instruction.opname in ("fadd", "fsub", "fmul", "fdiv")
    return count


def _offer(symbol):
    """Let kernels use an operator on lanes."""

    class Template(AbstractTemplate):
        key = symbol

        def generic(self, args, kws):
            if any(isinstance(kind, Lanes | Mask) for kind in args):
                return _tried(symbol, args)[0](*args)
            return None

    def lower(context, builder, signature, values):
        return _emit(symbol, context, builder, signature.args, values)[1]

    infer_global(symbol)(Template)
    for lanes in (Lanes, Mask):
        if symbol in (operator.neg, operator.invert):
            lower_builtin(symbol, lanes)(lower)
        else:
            lower_builtin(symbol, lanes, types.Any)(lower)
            lower_builtin(symbol, types.Any, lanes)(lower)
            lower_builtin(symbol, lanes, lanes)(lower)


for _symbol in (
    operator.add, operator.sub, operator.mul, operator.truediv, operator.neg, operator.lt, operator.le,
    operator.gt, operator.ge, operator.eq, operator.ne, operator.and_, operator.or_, operator.invert,
):  # fmt: skip
    _offer(_symbol)


def traced(function):
    """Make a function of numbers, tuples and arrays callable from numba's kernels, by tracing it."""
    if config.DISABLE_JIT:
        return function

    def definition(typingctx, *kinds):
        def codegen(context, builder, signature, values):
            return _emit(function, context, builder, kinds, values)[1]

        return _tried(function, kinds)[0](*kinds), codegen

    names = [inspect.Parameter("typingctx", inspect.Parameter.POSITIONAL_OR_KEYWORD)]
    names += inspect.signature(function).parameters.values()
    definition.__signature__ = inspect.Signature(names)  # type: ignore[attr-defined]
    intrinsic = _Traced(function.__name__, definition)
    intrinsic._register()
    update_wrapper(intrinsic, function)
    return intrinsic


def _stand_ins(*numbers):
    return [x for x in numbers if isinstance(x, Number)]


@traced
def where(condition, a, b):
    """a where the condition holds, else b; both are computed. Of numbers or tuples alike."""
    if isinstance(a, tuple):
        return tuple(where(condition, x, y) for x, y in zip(a, b, strict=True))
    if not isinstance(condition, Number):
        return a if condition else b
    tracer = condition.tracer
    if isinstance(condition.kind, Mask):
        any_kind = next((x.kind for x in _stand_ins(a, b) if isinstance(x.kind, Lanes | Mask)), None)
        if any_kind is None:
            (x,) = _stand_ins(a, b)[:1] or (None,)
            any_kind = Lanes(x.kind if x is not None else types.float64)
        like = Number(tracer, any_kind, None)
        a, b = tracer.number(a, like), tracer.number(b, like)
    elif not _stand_ins(a, b):
        a = tracer.number(a)
        b = tracer.number(b, a)
    else:
        a, b = tracer.alike(a, b)
    return Number(tracer, a.kind, tracer.builder.select(condition.value, a.value, b.value))


@traced
def fma(a, b, c):
    """a b + c, rounded once (by Python alone: twice)."""
    some = _stand_ins(a, b, c)
    if not some:
        return a * b + c
    return some[0].tracer.call("fma", *some[0].tracer.alike(a, b, c))


@traced
def sqrt(a):
    """√a; of a negative number it is not a number."""
    if not _stand_ins(a):
        return np.sqrt(a)
    return a.tracer.call("sqrt", a)


@traced
def least(a, b):
    """The smaller; a if they are equal, or not numbers."""
    return where(b < a, b, a)


@traced
def most(a, b):
    """The larger; a if they are equal, or not numbers."""
    return where(b > a, b, a)


@traced
def no(a):
    """Where a does not hold; Python's own `~` takes a truth for a number."""
    return ~a if isinstance(a, Number) else not a


@traced
def filled(x, value):
    """A number, or a truth, in each lane of x."""
    if not isinstance(x, Number):
        return value
    kind = x.kind
    if isinstance(value, bool) or (isinstance(value, Number) and _is_truth(value.kind)):
        kind = Mask(kind.width) if isinstance(kind, Lanes) else types.boolean
    return x.tracer.number(value, Number(x.tracer, kind, None))


@traced
def floor(a):
    """The largest whole number that is not above a, as a number with a fraction of nought."""
    if not _stand_ins(a):
        return np.floor(a)
    return a.tracer.call("floor", a)


@traced
def largest(a):
    """The largest of the lanes; of a number the number itself."""
    if not isinstance(a, Number) or not isinstance(a.kind, Lanes):
        return a
    builder = a.tracer.builder
    lane = [
        Number(a.tracer, a.kind.dtype, builder.extract_element(a.value, ir.Constant(ir.IntType(32), i)))
        for i in range(a.kind.width)
    ]
    while len(lane) > 1:
        lane = [most(x, y) for x, y in zip(lane[::2], lane[1::2], strict=True)]
    return lane[0]


@traced
def some(mask):
    """Does it hold in any lane?"""
    return _reduced("or", mask)


@traced
def every(mask):
    """Does it hold in all lanes?"""
    return _reduced("and", mask)


def _reduced(how, mask):
    if not isinstance(mask, Number) or not isinstance(mask.kind, Mask):
        return mask
    builder = mask.tracer.builder
    bits = builder.bitcast(mask.value, ir.IntType(mask.kind.width))
    if how == "or":
        value = builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))
    else:
        value = builder.icmp_unsigned("==", bits, ir.Constant(bits.type, -1))
    return Number(mask.tracer, types.boolean, value)
