"""What lanes have beside Python's operators: choosing, one lane of several, bits, and memory (lanes_kernels.py).

What chooses, rounds or gathers takes plain numbers as well: `any_lane` of a bool is that bool.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import signature
from numba.extending import intrinsic

from scenefold.render.lanes_kernels import (
    BIT_TYPE,
    FLAGS,
    I32_TYPE,
    LANES,
    REALS,
    WORDS,
    Lanes,
    call_llvm,
    common,
    lanes_of_number,
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
            kind = lanes_of_number(kind)
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
def bits_of_flags(typingctx, flags):
    """The flags of lanes as a whole number: that of lane k is worth 2^k."""
    if flags is not FLAGS:
        return None

    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), context.get_value_type(types.int64))

    return types.int64(flags), codegen


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
        kind = lanes_of_number(kind)
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


@intrinsic
def lane_numbers(typingctx):
    """0 in the first lane, 1 in the second, and so on."""

    def codegen(context, builder, sig, args):
        return ir.Constant(WORDS.vector, list(range(LANES)))

    return WORDS(), codegen


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


def _converter(takes: Lanes, gives: Lanes, build: Callable[[Any, Any], Any], about: str, plain: types.Type | None = None) -> Any:
    """A function of lanes. `build`: of the builder and the value. `plain`: what plain numbers become, if it takes them."""

    @intrinsic
    def convert(typingctx, value):
        if plain is not None and isinstance(types.unliteral(value), types.Number):

            def cast(context, builder, sig, args):
                return context.cast(builder, args[0], sig.args[0], plain)

            return signature(plain, value), cast
        if value is not takes:
            return None

        def codegen(context, builder, sig, args):
            return build(builder, args[0])

        return signature(gives, value), codegen

    convert.__doc__ = about
    return convert


bits_of = _converter(REALS, WORDS, lambda builder, value: builder.bitcast(value, WORDS.vector), "The 32 bits of f32.")
real_of_bits = _converter(WORDS, REALS, lambda builder, value: builder.bitcast(value, REALS.vector), "The f32 with these 32 bits.")
real_of_whole = _converter(
    WORDS,
    REALS,
    lambda builder, value: builder.sitofp(value, REALS.vector),
    "A whole number of 32 bits with a sign, as the nearest f32; a plain one as f64.",
    types.float64,
)
whole_of_real = _converter(
    REALS,
    WORDS,
    lambda builder, value: builder.fptosi(value, WORDS.vector),
    "The whole number of 32 bits with a sign that is left without what stands behind the point. It must be one: -2^31 <= real < 2^31.",
    types.int64,
)
reversed_bits = _converter(
    WORDS, WORDS, lambda builder, value: call_llvm(builder, f"llvm.bitreverse.v{LANES}i32", value), "The 32 bits, the last one first."
)


@intrinsic
def rounded_down(typingctx, value):
    """The largest whole number not above; of a plain number, as f64."""
    kind = value if value is REALS else types.float64
    name = f"llvm.floor.v{LANES}f32" if value is REALS else "llvm.floor.f64"

    def codegen(context, builder, sig, args):
        return call_llvm(builder, name, args[0] if value is REALS else context.cast(builder, args[0], sig.args[0], types.float64))

    return signature(kind, value), codegen


# Memory -----------------------------------------------------------------------------------------------------


@intrinsic
def gather(typingctx, array, places):
    """What lies in an array at these places, a tuple with an index for each dimension: lanes, or a number where all places are numbers.

    Reals as f32 and whole numbers as u32, of which the lower 32 bits; plain ones as f64 and u64. Nothing is checked.
    """
    many = any(isinstance(place, Lanes) for place in places)
    of_reals = isinstance(array.dtype, types.Float)
    if many:
        result = REALS if of_reals else WORDS
        element = result.element
    else:
        result = element = types.float64 if of_reals else types.uint64

    def codegen(context, builder, sig, args):
        view = context.make_array(sig.args[0])(context, builder, args[0])
        kinds = list(sig.args[1])
        values = cgutils.unpack_tuple(builder, args[1], len(kinds))

        def one(number: int) -> Any:
            indices = []
            for kind, value in zip(kinds, values, strict=True):
                if isinstance(kind, Lanes):
                    indices.append(builder.zext(builder.extract_element(value, I32_TYPE(number)), context.get_value_type(types.int64)))
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


@intrinsic
def take(typingctx, array, at):
    """Lanes that lie one after the other in uint32[n], or float32[n], from `at` on."""
    if array.dtype not in (types.uint32, types.float32):
        return None
    kind = REALS if array.dtype == types.float32 else WORDS

    def codegen(context, builder, sig, args):
        return builder.load(_lanes_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1], kind), align=4)

    return signature(kind, array, at), codegen


def _lanes_pointer(context: Any, builder: Any, array_type: Any, array: Any, index_type: Any, index: Any, kind: Lanes) -> Any:
    view = context.make_array(array_type)(context, builder, array)
    place = context.cast(builder, index, index_type, types.int64)
    pointer = cgutils.get_item_pointer(context, builder, array_type, view, [place], wraparound=False, boundscheck=False)
    return builder.bitcast(pointer, kind.vector.as_pointer())


@intrinsic
def put(typingctx, array, at, lanes):
    """Write lanes one after the other into uint32[n], or float32[n], from `at` on; bits are kept as they are."""
    if not isinstance(lanes, Lanes) or array.dtype not in (types.uint32, types.float32) or lanes is FLAGS:
        return None

    def codegen(context, builder, sig, args):
        builder.store(args[2], _lanes_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1], sig.args[2]), align=4)
        return context.get_dummy_value()

    return types.void(array, at, lanes), codegen


@intrinsic
def prefetch_row(typingctx, array, row):
    """Ask for the first cache line of a row of an array of two dimensions, which is about to be written, without waiting for it. Nothing is checked."""

    def codegen(context, builder, sig, args):
        view = context.make_array(sig.args[0])(context, builder, args[0])
        places = [context.cast(builder, args[1], sig.args[1], types.int64), context.get_constant(types.int64, 0)]
        pointer = cgutils.get_item_pointer(context, builder, sig.args[0], view, places, wraparound=False, boundscheck=False)
        pointer = builder.bitcast(pointer, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, I32_TYPE, I32_TYPE, I32_TYPE])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [pointer, I32_TYPE(1), I32_TYPE(3), I32_TYPE(1)])
        return context.get_dummy_value()

    return types.void(array, row), codegen
