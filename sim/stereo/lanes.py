"""Vectors of unsigned integers for compiled kernels: one operation works on all lanes.

The compiler proves too rarely that loops over arrays may be vectorised, and checks the arrays'
addresses before each loop. These vectors map to the processor's instructions on every machine.
Lanes wrap around as unsigned integers do.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model
from numpy.typing import NDArray


class Lanes(types.Type):
    """Type of a vector in compiled code."""

    def __init__(self, bits: int, count: int) -> None:
        self.bits, self.count = bits, count
        super().__init__(name=f"Lanes({bits}, {count})")

    @property
    def llvm(self) -> ir.VectorType:
        """Vector type of the compiler."""
        return ir.VectorType(ir.IntType(self.bits), self.count)


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, lanes: Lanes) -> None:
        super().__init__(manager, lanes, lanes.llvm)


WORDS, BYTES = Lanes(16, 16), Lanes(8, 32)


_compiled: Any = intrinsic  # Callers omit the first argument, the typing context.
_LINE = 64  # Bytes of a line of the cache; a vector that lies in two lines is read twice.


def aligned_words(*shape: int) -> NDArray[np.uint16]:
    """Return an uninitialised array that starts at a line of the cache."""
    size = 2 * int(np.prod(shape))
    raw = np.empty(size + _LINE, np.uint8)
    start = -raw.ctypes.data % _LINE
    return raw[start : start + size].view(np.uint16).reshape(shape)


def _call(builder: Any, name: str, lanes: Lanes, result: Any, arguments: list[Any]) -> Any:
    """Call an LLVM intrinsic that is overloaded on the vector's type."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    full = f"{name}.v{lanes.count}i{lanes.bits}"
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), arguments)


def _loader(lanes: Lanes, element: Any) -> Any:
    """Return a function that reads a vector from an array (array, first index)."""

    @_compiled
    def load(typing_context, array, at):
        def generate(context, builder, signature, arguments):
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            place = builder.gep(data, [arguments[1]])
            vector = builder.bitcast(place, lanes.llvm.as_pointer())
            return builder.load(vector, align=lanes.bits // 8)

        return lanes(types.Array(element, 1, "C"), types.intp), generate

    return load


def _storer(lanes: Lanes, element: Any) -> Any:
    """Return a function that writes a vector to an array (array, first index, vector)."""

    @_compiled
    def store(typing_context, array, at, vector):
        def generate(context, builder, signature, arguments):
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            place = builder.gep(data, [arguments[1]])
            target = builder.bitcast(place, lanes.llvm.as_pointer())
            builder.store(arguments[2], target, align=lanes.bits // 8)
            return context.get_dummy_value()

        return types.void(types.Array(element, 1, "C"), types.intp, lanes), generate

    return store


def _splatter(lanes: Lanes, element: Any) -> Any:
    """Return a function that repeats a number in all lanes."""

    @_compiled
    def splat(typing_context, value):
        def generate(context, builder, signature, arguments):
            empty = ir.Constant(lanes.llvm, ir.Undefined)
            first = builder.insert_element(empty, arguments[0], ir.Constant(ir.IntType(32), 0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes.count), [0] * lanes.count)
            return builder.shuffle_vector(first, empty, zeros)

        return lanes(element), generate

    return splat


def _binary(emit: Callable[[Any, Lanes, Any, Any], Any]) -> Any:
    """Return a function of two vectors of one type."""

    @_compiled
    def operate(typing_context, a, b):
        if not isinstance(a, Lanes) or a != b:
            return None

        def generate(context, builder, signature, arguments):
            return emit(builder, a, *arguments)

        return a(a, b), generate

    return operate


def _equal(builder: Any, lanes: Lanes, a: Any, b: Any) -> Any:
    return builder.sext(builder.icmp_unsigned("==", a, b), lanes.llvm)


def _above(builder: Any, lanes: Lanes, a: Any, b: Any) -> Any:
    return builder.sext(builder.icmp_signed(">", a, b), lanes.llvm)


def _high(builder: Any, lanes: Lanes, a: Any, b: Any) -> Any:
    wide = ir.VectorType(ir.IntType(2 * lanes.bits), lanes.count)
    product = builder.mul(builder.zext(a, wide), builder.zext(b, wide))
    shift = ir.Constant(wide, [lanes.bits] * lanes.count)
    return builder.trunc(builder.lshr(product, shift), lanes.llvm)


def _pushed(builder: Any, lanes: Lanes, a: Any, b: Any) -> Any:
    order = [lanes.count - 1 + lane for lane in range(lanes.count)]
    places = ir.Constant(ir.VectorType(ir.IntType(32), lanes.count), order)
    return builder.shuffle_vector(a, b, places)


load_words, load_bytes = _loader(WORDS, types.uint16), _loader(BYTES, types.uint8)
store_words, store_bytes = _storer(WORDS, types.uint16), _storer(BYTES, types.uint8)
splat_words, splat_bytes = _splatter(WORDS, types.uint16), _splatter(BYTES, types.uint8)

lesser = _binary(lambda builder, lanes, a, b: _call(builder, "llvm.umin", lanes, a.type, [a, b]))
greater = _binary(lambda builder, lanes, a, b: _call(builder, "llvm.umax", lanes, a.type, [a, b]))
excess = _binary(
    lambda builder, lanes, a, b: _call(builder, "llvm.usub.sat", lanes, a.type, [a, b])
)  # a - b, or 0 where a < b.
equal = _binary(_equal)  # All bits of a lane are set where both are equal.
above = _binary(_above)  # All bits of a lane are set where a > b, as signed numbers.
high_product = _binary(_high)  # Upper half of each product.
push = _binary(_pushed)  # Lanes of b, moved up by one; the first is the last lane of a.
_OPERATORS = {
    operator.add: _binary(lambda builder, lanes, a, b: builder.add(a, b)),
    operator.sub: _binary(lambda builder, lanes, a, b: builder.sub(a, b)),
    operator.mul: _binary(lambda builder, lanes, a, b: builder.mul(a, b)),
    operator.and_: _binary(lambda builder, lanes, a, b: builder.and_(a, b)),
    operator.or_: _binary(lambda builder, lanes, a, b: builder.or_(a, b)),
    operator.xor: _binary(lambda builder, lanes, a, b: builder.xor(a, b)),
    operator.rshift: _binary(lambda builder, lanes, a, b: builder.lshr(a, b)),
}


def _overload(sign: Any, operate: Any) -> None:
    @overload(sign)
    def overloaded(a, b):
        if isinstance(a, Lanes) and a == b:
            return lambda a, b: operate(a, b)
        return None


for _sign, _operate in _OPERATORS.items():
    _overload(_sign, _operate)


@_compiled
def store_low_bytes(typing_context, array, at, words):
    """Write the low byte of each word to an array of bytes, from an index on."""

    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        narrow = ir.VectorType(ir.IntType(8), WORDS.count)
        place = builder.bitcast(builder.gep(data, [arguments[1]]), narrow.as_pointer())
        builder.store(builder.trunc(arguments[2], narrow), place, align=1)
        return context.get_dummy_value()

    return types.void(types.Array(types.uint8, 1, "C"), types.intp, WORDS), generate


@_compiled
def read(typing_context, array, at):
    """Read an element without the check for an index that counts from the end."""

    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.load(builder.gep(data, [arguments[1]]))

    return array.dtype(array, types.intp), generate


@_compiled
def pick(typing_context, mask, a, b):
    """Return a where all bits of `mask` are set, and b where none is."""

    def generate(context, builder, signature, arguments):
        chosen, zero = arguments[0], ir.Constant(mask.llvm, [0] * mask.count)
        return builder.select(builder.icmp_unsigned("!=", chosen, zero), *arguments[1:])

    return a(mask, a, b), generate


@_compiled
def count_bits(typing_context, lanes):
    """Count the set bits of each lane."""

    def generate(context, builder, signature, arguments):
        return _call(builder, "llvm.ctpop", lanes, lanes.llvm, list(arguments))

    return lanes(lanes), generate


@_compiled
def least_lane(typing_context, lanes):
    """Return the least of all lanes."""

    def generate(context, builder, signature, arguments):
        element = ir.IntType(lanes.bits)
        return _call(builder, "llvm.vector.reduce.umin", lanes, element, list(arguments))

    return types.uint16(lanes), generate


def _half(start: int) -> Any:
    @_compiled
    def widen(typing_context, lanes):
        def generate(context, builder, signature, arguments):
            order = [start + lane for lane in range(WORDS.count)]
            places = ir.Constant(ir.VectorType(ir.IntType(32), WORDS.count), order)
            half = builder.shuffle_vector(arguments[0], arguments[0], places)
            return builder.zext(half, WORDS.llvm)

        return WORDS(BYTES), generate

    return widen


lower_words, upper_words = _half(0), _half(16)  # The first and the last 16 bytes as words.
