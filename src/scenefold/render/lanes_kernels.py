"""Lanes: four numbers that go through the same arithmetic at once, written as if they were one.

numba has no type for a vector register. Here are three: `REALS` (4 x f64), `WORDS` (4 x u64) and `FLAGS` (4 x bool), with the
operators of Python, `min`, `max`, `abs` and `math.sqrt` on them, so that one function serves numbers and lanes alike.
A number beside lanes counts for all four. What depends on a comparison is chosen by `select`, never by `if`: both sides are computed.

Every lane is rounded by itself, exactly as a number would be (IEEE 754; nothing is fused or reassociated), so
lanes change no bits: a test holds every function that is used on both against itself.

Functions of this file that are not operators also take plain numbers, where that makes sense: `any_lane` of a bool is that bool.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES: Final = 4

_I32, _I64, _BIT, _F64 = ir.IntType(32), ir.IntType(64), ir.IntType(1), ir.DoubleType()


class Lanes(types.Type):  # type: ignore[misc]
    """Four numbers of one type."""

    def __init__(self, element: types.Type, machine: ir.Type) -> None:
        self.element, self.vector = element, ir.VectorType(machine, LANES)
        super().__init__(name=f"lanes of {element}")

    @property
    def key(self) -> types.Type:
        return self.element


REALS: Final = Lanes(types.float64, _F64)
WORDS: Final = Lanes(types.uint64, _I64)
FLAGS: Final = Lanes(types.boolean, _BIT)
_LANES_OF: Final = {kind.element: kind for kind in (REALS, WORDS, FLAGS)}


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, kind.vector)


# What goes together -----------------------------------------------------------------------------------------


def _is_number(kind: types.Type) -> bool:
    return isinstance(types.unliteral(kind), (types.Number, types.Boolean))


def _common(left: types.Type, right: types.Type) -> Lanes | None:
    """The lanes that two operands make together; None if one of them is neither lanes nor a number, or both are numbers."""
    for one, other in ((left, right), (right, left)):
        if isinstance(one, Lanes) and (one == other or _is_number(other)):
            return one
    return None


def _spread(context, builder, kind: types.Type, value: Any, wanted: Lanes) -> Any:
    """The value as lanes: a number in each of them."""
    if isinstance(kind, Lanes):
        return value
    number = context.cast(builder, value, kind, wanted.element)
    if wanted is FLAGS:
        number = builder.trunc(number, _BIT) if number.type != _BIT else number
    nothing = ir.Constant(wanted.vector, ir.Undefined)
    first = builder.insert_element(nothing, number, _I32(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES))


def _both(context, builder, sig, args) -> tuple[Lanes, Any, Any]:
    wanted = _common(*sig.args)
    assert wanted is not None
    left, right = (_spread(context, builder, kind, value, wanted) for kind, value in zip(sig.args, args, strict=True))
    return wanted, left, right


def _llvm(builder, name: str, *operands: Any) -> Any:
    kind = operands[0].type
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [value.type for value in operands]), name)
    return builder.call(function, operands)


# Operators --------------------------------------------------------------------------------------------------

_Build = Callable[[Any, Lanes, Any, Any], Any]


def _binary(operation: Any, build: _Build, kinds: tuple[Lanes, ...], result: Lanes | None = None) -> None:
    """Teach numba `operation` on lanes of these kinds."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args, kws):
            if len(args) != 2 or kws:
                return None
            wanted = _common(*args)
            return signature(result or wanted, *args) if wanted in kinds else None

    def lower(context, builder, sig, args):
        return build(builder, *_both(context, builder, sig, args))

    infer_global(operation)(Template)
    for left, right in ((Lanes, Lanes), (Lanes, types.Any), (types.Any, Lanes)):
        lower_builtin(operation, left, right)(lower)


def _unary(operation: Any, build: Callable[[Any, Lanes, Any], Any], kinds: tuple[Lanes, ...]) -> None:
    class Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args, kws):
            return signature(args[0], *args) if len(args) == 1 and args[0] in kinds else None

    def lower(context, builder, sig, args):
        return build(builder, sig.args[0], args[0])

    infer_global(operation)(Template)
    lower_builtin(operation, Lanes)(lower)


def _by_kind(of_reals: str, of_words: str) -> _Build:
    return lambda builder, kind, left, right: getattr(builder, of_reals if kind is REALS else of_words)(left, right)


def _compared(how: str) -> _Build:
    def build(builder, kind, left, right):
        if kind is not REALS:
            return builder.icmp_unsigned(how, left, right)
        return builder.fcmp_unordered(how, left, right) if how == "!=" else builder.fcmp_ordered(how, left, right)

    return build


def _lesser(builder, _kind, left, right):
    # As numba has it for numbers: the first, unless the second is less.
    return builder.select(builder.fcmp_ordered("<", right, left), right, left)


def _greater(builder, _kind, left, right):
    return builder.select(builder.fcmp_ordered(">", right, left), right, left)


_binary(operator.add, _by_kind("fadd", "add"), (REALS, WORDS))
_binary(operator.sub, _by_kind("fsub", "sub"), (REALS, WORDS))
_binary(operator.mul, _by_kind("fmul", "mul"), (REALS, WORDS))
_binary(operator.truediv, lambda builder, _, left, right: builder.fdiv(left, right), (REALS,))
_binary(operator.floordiv, lambda builder, _, left, right: builder.udiv(left, right), (WORDS,))
_binary(operator.mod, lambda builder, _, left, right: builder.urem(left, right), (WORDS,))
_binary(operator.and_, lambda builder, _, left, right: builder.and_(left, right), (WORDS, FLAGS))
_binary(operator.or_, lambda builder, _, left, right: builder.or_(left, right), (WORDS, FLAGS))
_binary(operator.xor, lambda builder, _, left, right: builder.xor(left, right), (WORDS,))
_binary(operator.lshift, lambda builder, _, left, right: builder.shl(left, right), (WORDS,))
_binary(operator.rshift, lambda builder, _, left, right: builder.lshr(left, right), (WORDS,))
for _operation, _how in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "=="), (operator.ne, "!="),
):  # fmt: skip
    _binary(_operation, _compared(_how), (REALS, WORDS), FLAGS)
_binary(min, _lesser, (REALS,))
_binary(max, _greater, (REALS,))
_unary(operator.neg, lambda builder, _, value: builder.fneg(value), (REALS,))
_unary(operator.invert, lambda builder, _, value: builder.not_(value), (FLAGS, WORDS))
_unary(abs, lambda builder, _, value: _llvm(builder, f"llvm.fabs.v{LANES}f64", value), (REALS,))
_unary(math.sqrt, lambda builder, _, value: _llvm(builder, f"llvm.sqrt.v{LANES}f64", value), (REALS,))


# Choosing ---------------------------------------------------------------------------------------------------


@intrinsic
def select(typingctx, flag, yes, no):
    """`yes` where the flag is set, else `no`. Both are computed, and of one type; numbers become lanes where the flag is lanes."""
    kind = _common(yes, no)
    if kind is None:
        kind = types.unliteral(yes)
        if kind != types.unliteral(no):
            return None
        if isinstance(flag, Lanes):
            kind = _LANES_OF.get(kind)
            if kind is None:
                return None

    def codegen(context, builder, sig, args):
        if isinstance(kind, Lanes):
            left, right = (_spread(context, builder, sig.args[at], args[at], kind) for at in (1, 2))
        else:
            left, right = (context.cast(builder, args[at], sig.args[at], kind) for at in (1, 2))
        chosen = args[0] if isinstance(sig.args[0], Lanes) else context.is_true(builder, sig.args[0], args[0])
        return builder.select(chosen, left, right)

    return signature(kind, flag, yes, no), codegen


@intrinsic
def any_lane(typingctx, flag):
    """Whether the flag of any lane is set."""

    def codegen(context, builder, sig, args):
        if not isinstance(sig.args[0], Lanes):
            return context.is_true(builder, sig.args[0], args[0])
        together = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", together, ir.Constant(together.type, 0))

    return types.boolean(flag), codegen


@intrinsic
def opposite(typingctx, flag):
    """Not the flag."""

    def codegen(context, builder, sig, args):
        return builder.not_(args[0] if isinstance(sig.args[0], Lanes) else context.is_true(builder, sig.args[0], args[0]))

    return (FLAGS if flag is FLAGS else types.boolean)(flag), codegen


@intrinsic
def alike(typingctx, value, example):
    """The number, in as many lanes as the example has."""
    kind = types.unliteral(value)
    if isinstance(example, Lanes):
        kind = _LANES_OF.get(kind)
        if kind is None:
            return None

    def codegen(context, builder, sig, args):
        if isinstance(kind, Lanes):
            return _spread(context, builder, sig.args[0], args[0], kind)
        return context.cast(builder, args[0], sig.args[0], kind)

    return signature(kind, value, example), codegen


def _none(kind: Lanes) -> Any:
    @intrinsic
    def zeros(typingctx):
        """Lanes of zeros, or flags of which none is set, to be filled lane by lane."""

        def codegen(context, builder, sig, args):
            return ir.Constant(kind.vector, [0] * LANES)

        return kind(), codegen

    return zeros


no_words, no_flags = _none(WORDS), _none(FLAGS)


# One lane of several ----------------------------------------------------------------------------------------


@intrinsic
def lane_of(typingctx, lanes, number):
    """The number in one lane, counted from 0; of a number, itself."""

    def codegen(context, builder, sig, args):
        if not isinstance(sig.args[0], Lanes):
            return args[0]
        at = builder.trunc(context.cast(builder, args[1], sig.args[1], types.int64), _I32)
        value = builder.extract_element(args[0], at)
        return builder.zext(value, context.get_value_type(types.boolean)) if sig.args[0] is FLAGS and value.type != _BIT else value

    return signature(lanes.element if isinstance(lanes, Lanes) else types.unliteral(lanes), lanes, number), codegen


@intrinsic
def with_lane(typingctx, lanes, number, value):
    """The lanes with another number in one of them."""

    def codegen(context, builder, sig, args):
        element = context.cast(builder, args[2], sig.args[2], sig.args[0].element)
        at = builder.trunc(context.cast(builder, args[1], sig.args[1], types.int64), _I32)
        return builder.insert_element(args[0], element, at)

    return signature(lanes, lanes, number, value), codegen


# Between types ----------------------------------------------------------------------------------------------


def _kind_like(value: types.Type, of_lanes: Lanes, of_number: types.Type) -> types.Type:
    return of_lanes if isinstance(value, Lanes) else of_number


@intrinsic
def as_word(typingctx, value):
    """A whole number as u64; lanes of words as they are."""
    result = _kind_like(value, WORDS, types.uint64)

    def codegen(context, builder, sig, args):
        return args[0] if isinstance(sig.args[0], Lanes) else context.cast(builder, args[0], sig.args[0], types.uint64)

    return signature(result, value), codegen


@intrinsic
def bits_of(typingctx, value):
    """The 64 bits of f64."""
    result = _kind_like(value, WORDS, types.uint64)

    def codegen(context, builder, sig, args):
        real = args[0] if isinstance(sig.args[0], Lanes) else context.cast(builder, args[0], sig.args[0], types.float64)
        return builder.bitcast(real, context.get_value_type(result))

    return signature(result, value), codegen


@intrinsic
def real_of_bits(typingctx, value):
    """The f64 with these 64 bits."""
    result = _kind_like(value, REALS, types.float64)

    def codegen(context, builder, sig, args):
        word = args[0] if isinstance(sig.args[0], Lanes) else context.cast(builder, args[0], sig.args[0], types.uint64)
        return builder.bitcast(word, context.get_value_type(result))

    return signature(result, value), codegen


@intrinsic
def rounded_down(typingctx, value):
    """The largest whole number not above, as f64."""
    result = _kind_like(value, REALS, types.float64)

    def codegen(context, builder, sig, args):
        if isinstance(sig.args[0], Lanes):
            return _llvm(builder, f"llvm.floor.v{LANES}f64", args[0])
        return _llvm(builder, "llvm.floor.f64", context.cast(builder, args[0], sig.args[0], types.float64))

    return signature(result, value), codegen


@intrinsic
def in_f32(typingctx, value):
    """Rounded to f32, as f64."""
    result = _kind_like(value, REALS, types.float64)

    def codegen(context, builder, sig, args):
        if not isinstance(sig.args[0], Lanes):
            return builder.fpext(builder.fptrunc(context.cast(builder, args[0], sig.args[0], types.float64), ir.FloatType()), _F64)
        return builder.fpext(builder.fptrunc(args[0], ir.VectorType(ir.FloatType(), LANES)), REALS.vector)

    return signature(result, value), codegen


@intrinsic
def f32_of_bits(typingctx, value):
    """The f32 with the lower 32 bits, as f64."""
    result = _kind_like(value, REALS, types.float64)

    def codegen(context, builder, sig, args):
        many = isinstance(sig.args[0], Lanes)
        word = args[0] if many else context.cast(builder, args[0], sig.args[0], types.uint64)
        half, single = (ir.VectorType(_I32, LANES), ir.VectorType(ir.FloatType(), LANES)) if many else (_I32, ir.FloatType())
        return builder.fpext(builder.bitcast(builder.trunc(word, half), single), context.get_value_type(result))

    return signature(result, value), codegen


_BIG = 4503599627370496.0
_BIG_BITS = np.uint64(0x4330000000000000)
"""2^52: a number with this exponent holds a whole number below 2^52 in its last bits."""


_MANTISSA = np.uint64(0xFFFFFFFFFFFFF)


@njit(error_model="numpy", _nrt=False)
def real_of_word(word):
    """A whole number below 2^52 as f64, exactly: AVX2 has no instruction for that, but a mantissa that is one."""
    return real_of_bits(word | _BIG_BITS) - _BIG


@njit(error_model="numpy", _nrt=False)
def word_of_real(real):
    """A whole number from 0 to 2^52 - 1, which is f64, as 64 bits."""
    return bits_of(real + _BIG) & _MANTISSA


# Memory -----------------------------------------------------------------------------------------------------


@intrinsic
def gather(typingctx, array, places):
    """What lies in an array at these places, a tuple with an index for each dimension: lanes or numbers. Reals as f64, whole numbers as u64.

    Nothing is checked. A number where all places are numbers.
    """
    many = any(isinstance(place, Lanes) for place in places)
    of_reals = isinstance(array.dtype, types.Float)
    element = types.float64 if of_reals else types.uint64
    result = (REALS if of_reals else WORDS) if many else element

    def codegen(context, builder, sig, args):
        view = context.make_array(sig.args[0])(context, builder, args[0])
        kinds = list(sig.args[1])
        values = cgutils.unpack_tuple(builder, args[1], len(kinds))

        def one(number: int) -> Any:
            indices = []
            for kind, value in zip(kinds, values, strict=True):
                if isinstance(kind, Lanes):
                    indices.append(builder.extract_element(value, _I32(number)))
                else:
                    indices.append(context.cast(builder, value, kind, types.int64))
            pointer = cgutils.get_item_pointer(context, builder, sig.args[0], view, indices, wraparound=False, boundscheck=False)
            loaded = context.unpack_value(builder, sig.args[0].dtype, pointer)
            return context.cast(builder, loaded, sig.args[0].dtype, element)

        if not many:
            return one(0)
        gathered = ir.Constant(result.vector, ir.Undefined)
        for number in range(LANES):
            gathered = builder.insert_element(gathered, one(number), _I32(number))
        return gathered

    return signature(result, array, places), codegen
