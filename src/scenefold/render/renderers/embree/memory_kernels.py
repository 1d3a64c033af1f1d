"""Loads, stores and calls by address, for kernels that speak Embree's C interface.

numba refuses to cache kernels that close over ctypes pointers; addresses that arrive as plain numbers it does
not mind, and a call through one costs what it costs in C.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_I32, _I64, _FLOAT, _DOUBLE = ir.IntType(32), ir.IntType(64), ir.FloatType(), ir.DoubleType()


@intrinsic
def call_with_3(typingctx, function, a, b, c):  # type: ignore[no-untyped-def]
    """Call the C function at an address with three pointer-sized arguments; it returns nothing."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = ir.FunctionType(ir.VoidType(), [_I64, _I64, _I64]).as_pointer()
        builder.call(builder.inttoptr(args[0], pointer), list(args[1:]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), codegen


@intrinsic
def load_i64(typingctx, address):  # type: ignore[no-untyped-def]
    """The int64 at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], _I64.as_pointer()))

    return types.int64(types.int64), codegen


@intrinsic
def load_u32(typingctx, address):  # type: ignore[no-untyped-def]
    """The uint32 at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], _I32.as_pointer()))

    return types.uint32(types.int64), codegen


@intrinsic
def load_f32(typingctx, address):  # type: ignore[no-untyped-def]
    """The float32 at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], _FLOAT.as_pointer()))

    return types.float32(types.int64), codegen


@intrinsic
def load_f64(typingctx, address):  # type: ignore[no-untyped-def]
    """The float64 at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], _DOUBLE.as_pointer()))

    return types.float64(types.int64), codegen


@intrinsic
def store_u32(typingctx, address, value):  # type: ignore[no-untyped-def]
    """Write a uint32 to an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.store(args[1], builder.inttoptr(args[0], _I32.as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.uint32), codegen


@intrinsic
def store_f32(typingctx, address, value):  # type: ignore[no-untyped-def]
    """Write a float32 to an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.store(args[1], builder.inttoptr(args[0], _FLOAT.as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.float32), codegen


@intrinsic
def prefetch(typingctx, address):  # type: ignore[no-untyped-def]
    """Ask for what lies at an address to be brought into the caches, without waiting for it; any address will do."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = builder.inttoptr(args[0], ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, _I32, _I32, _I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [pointer, _I32(0), _I32(3), _I32(1)])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


@intrinsic
def f64_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to float64, for `numba.carray`."""
    return _pointer_to(types.float64)


@intrinsic
def f32_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to float32."""
    return _pointer_to(types.float32)


@intrinsic
def i64_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to int64."""
    return _pointer_to(types.int64)


@intrinsic
def u32_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to uint32."""
    return _pointer_to(types.uint32)


@intrinsic
def u16_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to uint16."""
    return _pointer_to(types.uint16)


@intrinsic
def u8_at(typingctx, address):  # type: ignore[no-untyped-def]
    """A pointer to uint8."""
    return _pointer_to(types.uint8)


def _pointer_to(element):  # type: ignore[no-untyped-def]
    result = types.CPointer(element)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], context.get_value_type(result))

    return result(types.int64), codegen
