"""The switch of faults in compiled code: reads and writes the memory of `mutants.switch`."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core.errors import RequireLiteralValue
from numba.extending import intrinsic, overload

from mutants.switch import ADDRESS, REACHED, switch

__all__ = ["switch"]


@intrinsic(prefer_literal=True)
def _noted(typingctx, number):
    if not isinstance(number, types.IntegerLiteral):
        raise RequireLiteralValue("the number of a fault")
    value = number.literal_value

    def on(context, builder, signature, arguments):
        byte, word = ir.IntType(8), ir.IntType(64)
        place = builder.inttoptr(ir.Constant(word, REACHED + value), byte.as_pointer())
        builder.store(ir.Constant(byte, 1), place)
        pointer = builder.inttoptr(ir.Constant(word, ADDRESS), word.as_pointer())
        return builder.icmp_signed("==", builder.load(pointer), ir.Constant(word, value))

    return types.boolean(types.int64), on


@overload(switch, prefer_literal=True)
def _switch(number):
    return lambda number: _noted(number)
