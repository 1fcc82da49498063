"""Sixteen small integers at once, inside compiled loops: what a processor's vector unit does, by name.

A compiler finds such code by itself only where it can prove that no two arrays overlap, which it cannot for arrays
that come from outside. Here it is told. `Bytes` are 16 unsigned 8-bit lanes, `Shorts` 16 signed 16-bit ones; both live
in registers. Any processor will do: where lanes are fewer, the compiler takes two steps for one.

Arrays are flat and contiguous; an index counts elements and is not checked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic
from numba.extending import models, register_model

intrinsic: Any = _intrinsic
LANES = 16


class _Lanes(types.Type):
    """The type of 16 lanes of so many bits."""

    def __init__(self, bits: int) -> None:
        self.bits = bits
        super().__init__(name=f"Lanes({bits})")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Lanes) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(kind.bits), LANES))


BYTES, SHORTS = _Lanes(8), _Lanes(16)
_ELEMENT = {BYTES: types.uint8, SHORTS: types.int16}
_VECTOR = {kind: ir.VectorType(ir.IntType(kind.bits), LANES) for kind in _ELEMENT}


def _place(context: Any, builder: Any, kind: _Lanes, array_type: Any, array: Any, index: Any) -> Any:
    """Pointer to the lanes at `index` of a flat array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR[kind].as_pointer())


def _loader(kind: _Lanes) -> Callable[..., Any]:
    def load(typing: Any, array: Any, index: Any) -> Any:
        if array.dtype != _ELEMENT[kind]:
            return None

        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            index = context.cast(builder, values[1], signature.args[1], types.intp)
            return builder.load(
                _place(context, builder, kind, signature.args[0], values[0], index), align=kind.bits // 8
            )

        return kind(array, index), build

    return load


def _storer(kind: _Lanes) -> Callable[..., Any]:
    def store(typing: Any, array: Any, index: Any, lanes: Any) -> Any:
        if array.dtype != _ELEMENT[kind]:
            return None

        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            index = context.cast(builder, values[1], signature.args[1], types.intp)
            place = _place(context, builder, kind, signature.args[0], values[0], index)
            builder.store(values[2], place, align=kind.bits // 8)
            return context.get_dummy_value()

        return types.void(array, index, kind), build

    return store


def _everywhere(builder: Any, kind: _Lanes, one: Any) -> Any:
    """A number in every lane."""
    first = builder.insert_element(ir.Constant(_VECTOR[kind], ir.Undefined), one, ir.IntType(32)(0))
    return builder.shuffle_vector(
        first, first, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    )


def _spreader(kind: _Lanes) -> Callable[..., Any]:
    def spread(typing: Any, value: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            one = context.cast(builder, values[0], signature.args[0], _ELEMENT[kind])
            return _everywhere(builder, kind, one)

        return kind(value), build

    return spread


def _called(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    """What an intrinsic function of the compiler gives."""
    signature = ir.FunctionType(result, [a.type for a in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, signature, name), arguments)


def _pairwise(make: Callable[[Any, _Lanes, Any, Any], Any]) -> Callable[..., Any]:
    """An operation on two of one kind. make: of the builder, the kind and both values."""

    def operation(typing: Any, a: Any, b: Any) -> Any:
        if a != b or a not in _ELEMENT:
            return None

        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return make(builder, a, *values)

        return a(a, b), build

    return operation


def _named(signed: str, unsigned: str) -> Callable[..., Any]:
    def make(builder: Any, kind: _Lanes, a: Any, b: Any) -> Any:
        name = signed if kind is SHORTS or kind.bits == 16 else unsigned
        return _called(builder, f"llvm.{name}.v{LANES}i{kind.bits}", a.type, [a, b])

    return _pairwise(make)


def _shuffled(first: int) -> Callable[..., Any]:
    def make(builder: Any, kind: _Lanes, a: Any, b: Any) -> Any:
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), list(range(first, first + LANES)))
        return builder.shuffle_vector(a, b, mask)

    return _pairwise(make)


load_bytes = intrinsic(_loader(BYTES))
"""`load_bytes(array, index)`: 16 elements of a uint8 array."""
load_shorts = intrinsic(_loader(SHORTS))
"""`load_shorts(array, index)`: 16 elements of an int16 array."""
store_bytes = intrinsic(_storer(BYTES))
store_shorts = intrinsic(_storer(SHORTS))
"""`store_shorts(array, index, lanes)`."""
spread_bytes = intrinsic(_spreader(BYTES))
spread_shorts = intrinsic(_spreader(SHORTS))
"""`spread_shorts(value)`: the same number in every lane."""
plus = intrinsic(_pairwise(lambda builder, kind, a, b: builder.add(a, b)))
"""`plus(a, b)`, modulo the lane's size."""
minus = intrinsic(_pairwise(lambda builder, kind, a, b: builder.sub(a, b)))
above = intrinsic(_named("ssub.sat", "usub.sat"))
"""`above(a, b)`: a - b, of bytes 0 where b is larger."""
least = intrinsic(_named("smin", "umin"))
most = intrinsic(_named("smax", "umax"))
before_one = intrinsic(_shuffled(LANES - 1))
"""`before_one(a, b)`: the lanes of b moved up by one, the last of a before them."""
after_one = intrinsic(_shuffled(1))
"""`after_one(a, b)`: the lanes of a moved down by one, the first of b behind them."""
halves_changed = intrinsic(_shuffled(LANES // 2))
"""`halves_changed(a, b)`: the second half of a, then the first half of b."""


@intrinsic
def quarter(typing: Any, a: Any) -> Any:
    """Bytes, each divided by four."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.lshr(values[0], ir.Constant(_VECTOR[BYTES], [2] * LANES))

    return BYTES(BYTES), build


@intrinsic
def between(typing: Any, a: Any, b: Any) -> Any:
    """The mean of bytes, rounded down."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        a, b = values
        half = builder.lshr(builder.xor(a, b), ir.Constant(_VECTOR[BYTES], [1] * LANES))
        return builder.add(builder.and_(a, b), half)

    return BYTES(BYTES, BYTES), build


@intrinsic
def narrowed(typing: Any, a: Any) -> Any:
    """Shorts of 0...255 as bytes."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.trunc(values[0], _VECTOR[BYTES])

    return BYTES(SHORTS), build


@intrinsic
def widened(typing: Any, a: Any) -> Any:
    """Bytes as shorts."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.zext(values[0], _VECTOR[SHORTS])

    return SHORTS(BYTES), build


@intrinsic
def spread_smallest(typing: Any, a: Any) -> Any:
    """The smallest of 16 shorts, none of them negative, in every lane."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        one = _called(builder, f"llvm.vector.reduce.umin.v{LANES}i16", ir.IntType(16), [values[0]])
        return _everywhere(builder, SHORTS, one)

    return SHORTS(SHORTS), build


@intrinsic
def first_lane(typing: Any, a: Any) -> Any:
    """The first of 16 shorts, as a number."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.extract_element(values[0], ir.IntType(32)(0))

    return types.int16(SHORTS), build


@intrinsic
def chosen(typing: Any, a: Any, b: Any, same: Any, other: Any) -> Any:
    """Shorts: lanes of `same` where a and b are equal, of `other` elsewhere."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        a, b, same, other = values
        return builder.select(builder.icmp_signed("==", a, b), same, other)

    return SHORTS(SHORTS, SHORTS, SHORTS, SHORTS), build


@intrinsic
def counted(typing: Any) -> Any:
    """Shorts: 0, 1, ... 15."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return ir.Constant(_VECTOR[SHORTS], list(range(LANES)))

    return SHORTS(), build
