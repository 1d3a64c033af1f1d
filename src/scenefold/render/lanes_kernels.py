"""Lanes: eight numbers that go through the same arithmetic at once, written as if they were one.

numba has no type for a vector register. Here are three: `REALS` (8 x f32), `WORDS` (8 x u32) and `FLAGS` (8 x bool), with the
operators of Python, `min`, `max`, `abs` and `math.sqrt` on them. A number beside lanes counts for all eight, rounded to
their type. What depends on a comparison is chosen by `select`, never by `if`: both sides are computed.

Every lane is rounded by itself (IEEE 754 single precision; nothing is fused or reassociated), so what comes of a ray does not
depend on its company: a test puts rays into other lanes, and asks for the same bits. Most functions take plain numbers
too, and then compute in double precision: another test holds lanes against that.

What is no operator of Python is in lane_values_kernels.py.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

LANES: Final = 8

I32_TYPE, BIT_TYPE, F32_TYPE = ir.IntType(32), ir.IntType(1), ir.FloatType()


class Lanes(types.Type):  # type: ignore[misc]
    """Four numbers of one type."""

    def __init__(self, element: types.Type, machine: ir.Type) -> None:
        self.element, self.vector = element, ir.VectorType(machine, LANES)
        super().__init__(name=f"lanes of {element}")

    @property
    def key(self) -> types.Type:
        return self.element


REALS: Final = Lanes(types.float32, F32_TYPE)
WORDS: Final = Lanes(types.uint32, I32_TYPE)
FLAGS: Final = Lanes(types.boolean, BIT_TYPE)


def lanes_of_number(kind: types.Type) -> Lanes | None:
    """The lanes in which numbers of this type go."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Boolean):
        return FLAGS
    if isinstance(kind, types.Float):
        return REALS
    return WORDS if isinstance(kind, types.Integer) else None


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, kind.vector)


# What goes together -----------------------------------------------------------------------------------------


def _is_number(kind: types.Type) -> bool:
    return isinstance(types.unliteral(kind), (types.Number, types.Boolean))


def common(left: types.Type, right: types.Type) -> Lanes | None:
    """The lanes that two operands make together; None if one of them is neither lanes nor a number, or both are numbers."""
    for one, other in ((left, right), (right, left)):
        if isinstance(one, Lanes) and (one == other or _is_number(other)):
            return one
    return None


def spread(context: Any, builder: Any, kind: types.Type, value: Any, wanted: Lanes) -> Any:
    """The value as lanes: a number in each of them."""
    if isinstance(kind, Lanes):
        return value
    number = context.cast(builder, value, kind, wanted.element)
    if wanted is FLAGS:
        number = builder.trunc(number, BIT_TYPE) if number.type != BIT_TYPE else number
    nothing = ir.Constant(wanted.vector, ir.Undefined)
    first = builder.insert_element(nothing, number, I32_TYPE(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(I32_TYPE, LANES), [0] * LANES))


def _both(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Lanes, Any, Any]:
    wanted = common(*sig.args)
    assert wanted is not None
    left, right = (spread(context, builder, kind, value, wanted) for kind, value in zip(sig.args, args, strict=True))
    return wanted, left, right


def call_llvm(builder: Any, name: str, *operands: Any) -> Any:
    """Call an intrinsic of LLVM whose result is of its operands' type."""
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
            wanted = common(*args)
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
_unary(abs, lambda builder, _, value: call_llvm(builder, f"llvm.fabs.v{LANES}f32", value), (REALS,))
_unary(math.sqrt, lambda builder, _, value: call_llvm(builder, f"llvm.sqrt.v{LANES}f32", value), (REALS,))
