"""A register full of numbers at once, inside compiled loops: what is computed of many pixels side by side.

`load`, `gather` and `doubles` make them, arithmetic and comparisons work on them lane by lane as on numbers, `choose`
takes the place of a branch. A number among them counts for every lane. Of four bytes each a register holds 16, of
eight bytes 8; what is converted keeps its count. As with `lanes`, any processor will do: where
fewer fit into a register, the compiler takes several steps for one. Floating point is as with `fastmath`.

Arrays are contiguous; an index counts elements of the flat array and is not checked.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic as _intrinsic
from numba.extending import models, register_model

intrinsic: Any = _intrinsic
REGISTER_BITS = 512
FLOATS, DOUBLES = 16, 8
"""How many floats or ints, doubles or longs are one."""
_FAST = ("nnan", "ninf", "nsz", "arcp", "contract", "afn")
"""As `fastmath`, but sums are made in the order in which they are written."""


class _Wide(types.Type):
    """The type of so many lanes of one numba type."""

    def __init__(self, element: Any, count: int) -> None:
        self.element, self.count = element, count
        super().__init__(name=f"Wide({element}, {count})")

    def of(self, element: Any) -> _Wide:
        """As many lanes of another type."""
        return _Wide(element, self.count)


_ELEMENT = {
    types.float32: ir.FloatType(), types.float64: ir.DoubleType(), types.int32: ir.IntType(32),
    types.int64: ir.IntType(64), types.boolean: ir.IntType(1),
}  # fmt: skip
_SHORT = {types.float32: "f32", types.float64: "f64", types.int32: "i32", types.int64: "i64"}


@register_model(_Wide)
class _WideModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Wide) -> None:
        super().__init__(manager, kind, _vector(kind))


def _vector(kind: _Wide) -> Any:
    return ir.VectorType(_ELEMENT[kind.element], kind.count)


def _register(element: Any) -> _Wide:
    """As many lanes as a register holds."""
    return _Wide(element, REGISTER_BITS // element.bitwidth)


def _everywhere(builder: Any, kind: _Wide, one: Any) -> Any:
    vector = _vector(kind)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), one, ir.IntType(32)(0))
    return builder.shuffle_vector(
        first, first, ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    )


def _lanes(context: Any, builder: Any, kind: _Wide, given: Any, value: Any) -> Any:
    """A value as lanes of that kind: those it has, or one number in all of them."""
    if isinstance(given, _Wide):
        return value
    return _everywhere(builder, kind, context.cast(builder, value, given, kind.element))


def _operation(symbol: Any, build: Callable[[Any, Any, Any, Any], Any], compares: bool = False) -> None:
    """Give an operator of Python a meaning for lanes: build(builder, element, a, b)."""

    class Typed(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            wide = [a for a in args if isinstance(a, _Wide)]
            if len(args) != 2 or not wide or any(a != wide[0] for a in wide):
                return None
            if not all(isinstance(a, _Wide | types.Number) for a in args):
                return None
            return signature(wide[0].of(types.boolean) if compares else wide[0], *args)

    infer_global(symbol)(Typed)

    def lower(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        kind = next(a for a in sig.args if isinstance(a, _Wide))
        a, b = (_lanes(context, builder, kind, t, v) for t, v in zip(sig.args, values, strict=True))
        return build(builder, kind.element, a, b)

    for first, second in ((_Wide, _Wide), (_Wide, types.Number), (types.Number, _Wide)):
        lower_builtin(symbol, first, second)(lower)


def _arithmetic(of_floats: str, of_integers: str) -> Callable[[Any, Any, Any, Any], Any]:
    def build(builder: Any, element: Any, a: Any, b: Any) -> Any:
        if isinstance(element, types.Float):
            return getattr(builder, of_floats)(a, b, flags=_FAST)
        return getattr(builder, of_integers)(a, b)

    return build


def _comparison(symbol: str) -> Callable[[Any, Any, Any, Any], Any]:
    def build(builder: Any, element: Any, a: Any, b: Any) -> Any:
        if isinstance(element, types.Float):
            return builder.fcmp_ordered(symbol, a, b, flags=_FAST)
        return builder.icmp_signed(symbol, a, b)

    return build


for _symbol, _names in {
    operator.add: ("fadd", "add"), operator.sub: ("fsub", "sub"), operator.mul: ("fmul", "mul"),
    operator.truediv: ("fdiv", ""), operator.and_: ("", "and_"), operator.or_: ("", "or_"),
    operator.lshift: ("", "shl"), operator.rshift: ("", "ashr"),
}.items():  # fmt: skip
    _operation(_symbol, _arithmetic(*_names))
for _symbol, _sign in {
    operator.lt: "<", operator.gt: ">", operator.le: "<=", operator.ge: ">=", operator.eq: "==",
}.items():  # fmt: skip
    _operation(_symbol, _comparison(_sign), True)


def _called(builder: Any, name: str, result: Any, arguments: list[Any], fast: bool = False) -> Any:
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, [a.type for a in arguments]), name
    )
    return builder.call(function, arguments, fastmath=_FAST if fast else ())


def _place(context: Any, builder: Any, array_type: Any, array: Any, index_type: Any, index: Any) -> Any:
    """Pointer to the lanes at `index` of a flat array."""
    index = context.cast(builder, index, index_type, types.intp)
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _vector(_register(array_type.dtype)).as_pointer())


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """A register of elements from `index` on."""

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        place = _place(context, builder, sig.args[0], values[0], sig.args[1], values[1])
        return builder.load(place, align=array.dtype.bitwidth // 8)

    return _register(array.dtype)(array, index), build


@intrinsic
def store(typing: Any, array: Any, index: Any, lanes: Any) -> Any:
    """The elements from `index` on become these."""

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        place = _place(context, builder, sig.args[0], values[0], sig.args[1], values[1])
        builder.store(values[2], place, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, index, lanes), build


@intrinsic
def gather(typing: Any, array: Any, index: Any) -> Any:
    """One element for each lane of `index`, longs; of bytes, four in a row as one int, the first of them lowest."""
    kind = index.of(types.int32 if array.dtype == types.uint8 else array.dtype)

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, values[0]).data
        base = _everywhere(builder, index, builder.ptrtoint(data, ir.IntType(64)))
        bytes_each = array.dtype.bitwidth // 8
        address = builder.add(
            base, builder.mul(values[1], ir.Constant(_vector(index), [bytes_each] * kind.count))
        )
        pointers = builder.inttoptr(address, ir.VectorType(_ELEMENT[kind.element].as_pointer(), kind.count))
        name = f"v{kind.count}{_SHORT[kind.element]}"
        every = ir.Constant(ir.VectorType(ir.IntType(1), kind.count), [1] * kind.count)
        arguments = [pointers, ir.IntType(32)(bytes_each), every, ir.Constant(_vector(kind), ir.Undefined)]
        return _called(
            builder,
            f"llvm.masked.gather.{name}.v{kind.count}p0{name[len(str(kind.count)) + 1 :]}",
            _vector(kind),
            arguments,
        )

    return kind(array, index), build


def _spreader(kind: _Wide) -> Any:
    def spread(typing: Any, value: Any) -> Any:
        def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            return _lanes(context, builder, kind, sig.args[0], values[0])

        return kind(value), build

    return intrinsic(spread)


floats, doubles, ints, longs = (
    _spreader(_register(element)) for element in (types.float32, types.float64, types.int32, types.int64)
)
"""`doubles(value)`: a number in every lane."""


@intrinsic
def choose(typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """Lanes of a where the mask holds, of b elsewhere."""
    kind = next((t for t in (a, b) if isinstance(t, _Wide)), None)
    if kind is None:
        whole = all(isinstance(t, types.Integer) for t in (a, b))
        kind = mask.of(types.int64 if whole else types.float64)

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        a, b = (_lanes(context, builder, kind, t, v) for t, v in zip(sig.args[1:], values[1:], strict=True))
        return builder.select(values[0], a, b)

    return kind(mask, a, b), build


def _converter(wanted: Any) -> Any:
    """Lanes as another kind; of floating point, what is behind the point is dropped."""

    def convert(typing: Any, a: Any) -> Any:
        def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            given, vector = a.element, _vector(a.of(wanted))
            if isinstance(given, types.Float) and isinstance(wanted, types.Float):
                wider = wanted.bitwidth > given.bitwidth
                return (builder.fpext if wider else builder.fptrunc)(values[0], vector)
            if isinstance(given, types.Float):
                return builder.fptosi(values[0], vector)
            if isinstance(wanted, types.Float):
                return builder.sitofp(values[0], vector)
            wider = wanted.bitwidth > given.bitwidth
            return (builder.sext if wider else builder.trunc)(values[0], vector)

        return a.of(wanted)(a), build

    return intrinsic(convert)


as_floats, as_doubles, as_ints, as_longs = (
    _converter(element) for element in (types.float32, types.float64, types.int32, types.int64)
)


@intrinsic
def down(typing: Any, a: Any) -> Any:
    """Rounded towards minus infinity."""
    name = f"llvm.floor.v{a.count}f{a.element.bitwidth}"
    return a(a), lambda context, builder, sig, values: _called(builder, name, _vector(a), [values[0]], True)


@intrinsic
def fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once where the processor can."""
    name = f"llvm.fmuladd.v{a.count}f{a.element.bitwidth}"
    return a(a, b, c), lambda context, builder, sig, values: _called(builder, name, _vector(a), list(values))


@intrinsic
def size(typing: Any, a: Any) -> Any:
    """Without sign."""
    name = f"llvm.fabs.v{a.count}f{a.element.bitwidth}"
    return a(a), lambda context, builder, sig, values: _called(builder, name, _vector(a), [values[0]], True)


@intrinsic
def bits(typing: Any, a: Any) -> Any:
    """Doubles as they lie in memory: sign, 11 bits of exponent + 1023, 52 bits of fraction."""
    kind = a.of(types.int64)
    return kind(a), lambda context, builder, sig, values: builder.bitcast(values[0], _vector(kind))


@intrinsic
def doubles_of_bits(typing: Any, a: Any) -> Any:
    """The inverse of `bits`."""
    kind = a.of(types.float64)
    return kind(a), lambda context, builder, sig, values: builder.bitcast(values[0], _vector(kind))


@intrinsic
def some(typing: Any, mask: Any) -> Any:
    """Whether the mask holds in any lane."""

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        packed = builder.bitcast(values[0], ir.IntType(mask.count))
        return builder.icmp_unsigned("!=", packed, ir.IntType(mask.count)(0))

    return types.boolean(mask), build


@intrinsic
def counted(typing: Any) -> Any:
    """Ints 0, 1, ... 15."""
    kind = _register(types.int32)
    lanes = ir.Constant(_vector(kind), list(range(kind.count)))
    return kind(), lambda context, builder, sig, values: lanes


@intrinsic
def smallest(typing: Any, a: Any) -> Any:
    """The least of all lanes."""
    element = _ELEMENT[a.element]
    name = f"llvm.vector.reduce.fmin.v{a.count}f{a.element.bitwidth}"
    return a.element(a), lambda context, builder, sig, values: _called(
        builder, name, element, [values[0]], True
    )
