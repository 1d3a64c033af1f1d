"""What lanes have beside Python's operators: choosing, one lane of several, bits, and memory (lanes_kernels.py).

All of it takes plain numbers as well, where that makes sense: `any_lane` of a bool is that bool.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import signature
from numba.extending import intrinsic

from scenefold.render.lanes_kernels import (
    BIT_TYPE,
    FLAGS,
    I32_TYPE,
    LANES,
    LANES_OF,
    REALS,
    WORDS,
    Lanes,
    call_llvm,
    common,
    spread,
)

# Choosing ---------------------------------------------------------------------------------------------------


@intrinsic
def select(typingctx, flag, yes, no):
    """`yes` where the flag is set, else `no`. Both are computed, and of one type; numbers become lanes where the flag is lanes."""
    kind = common(yes, no)
    if kind is None:
        kind = types.unliteral(yes)
        if kind != types.unliteral(no):
            return None
        if isinstance(flag, Lanes):
            kind = LANES_OF.get(kind)
            if kind is None:
                return None

    def codegen(context, builder, sig, args):
        if isinstance(kind, Lanes):
            left, right = (spread(context, builder, sig.args[at], args[at], kind) for at in (1, 2))
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
        kind = LANES_OF.get(kind)
        if kind is None:
            return None

    def codegen(context, builder, sig, args):
        if isinstance(kind, Lanes):
            return spread(context, builder, sig.args[0], args[0], kind)
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
        at = builder.trunc(context.cast(builder, args[1], sig.args[1], types.int64), I32_TYPE)
        value = builder.extract_element(args[0], at)
        return builder.zext(value, context.get_value_type(types.boolean)) if sig.args[0] is FLAGS and value.type != BIT_TYPE else value

    return signature(lanes.element if isinstance(lanes, Lanes) else types.unliteral(lanes), lanes, number), codegen


@intrinsic
def with_lane(typingctx, lanes, number, value):
    """The lanes with another number in one of them."""

    def codegen(context, builder, sig, args):
        element = context.cast(builder, args[2], sig.args[2], sig.args[0].element)
        at = builder.trunc(context.cast(builder, args[1], sig.args[1], types.int64), I32_TYPE)
        return builder.insert_element(args[0], element, at)

    return signature(lanes, lanes, number, value), codegen


# Between types ----------------------------------------------------------------------------------------------


def _converter(takes: Lanes, gives: Lanes, build: Callable[[Any, Any, bool], Any], about: str) -> Any:
    """A function of lanes, or of a number. `build`: of the builder, the value and whether there are several."""

    @intrinsic
    def convert(typingctx, value):
        several = isinstance(value, Lanes)
        if several and value is not takes:
            return None
        result = gives if several else gives.element

        def codegen(context, builder, sig, args):
            operand = args[0] if several else context.cast(builder, args[0], sig.args[0], takes.element)
            return build(builder, operand, several)

        return signature(result, value), codegen

    convert.__doc__ = about
    return convert


def _machine(lanes: Lanes, several: bool) -> ir.Type:
    return lanes.vector if several else lanes.vector.element


def _singles(kind: ir.Type, several: bool) -> ir.Type:
    """As many of another type."""
    return ir.VectorType(kind, LANES) if several else kind


def _floored(builder: Any, value: Any, several: bool) -> Any:
    return call_llvm(builder, f"llvm.floor.v{LANES}f64" if several else "llvm.floor.f64", value)


def _to_f32(builder: Any, value: Any, several: bool) -> Any:
    return builder.fpext(builder.fptrunc(value, _singles(ir.FloatType(), several)), _machine(REALS, several))


def _of_f32_bits(builder: Any, value: Any, several: bool) -> Any:
    single = builder.bitcast(builder.trunc(value, _singles(I32_TYPE, several)), _singles(ir.FloatType(), several))
    return builder.fpext(single, _machine(REALS, several))


as_word = _converter(WORDS, WORDS, lambda _, value, __: value, "A whole number as u64; lanes of words as they are.")
bits_of = _converter(REALS, WORDS, lambda builder, value, several: builder.bitcast(value, _machine(WORDS, several)), "The 64 bits of f64.")
real_of_bits = _converter(
    WORDS, REALS, lambda builder, value, several: builder.bitcast(value, _machine(REALS, several)), "The f64 with these 64 bits."
)
rounded_down = _converter(REALS, REALS, _floored, "The largest whole number not above, as f64.")
in_f32 = _converter(REALS, REALS, _to_f32, "Rounded to f32, as f64.")
f32_of_bits = _converter(WORDS, REALS, _of_f32_bits, "The f32 with the lower 32 bits, as f64.")

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
                    indices.append(builder.extract_element(value, I32_TYPE(number)))
                else:
                    indices.append(context.cast(builder, value, kind, types.int64))
            pointer = cgutils.get_item_pointer(context, builder, sig.args[0], view, indices, wraparound=False, boundscheck=False)
            loaded = context.unpack_value(builder, sig.args[0].dtype, pointer)
            return context.cast(builder, loaded, sig.args[0].dtype, element)

        if not many:
            return one(0)
        gathered = ir.Constant(result.vector, ir.Undefined)
        for number in range(LANES):
            gathered = builder.insert_element(gathered, one(number), I32_TYPE(number))
        return gathered

    return signature(result, array, places), codegen
