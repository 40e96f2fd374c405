"""Eight scenes in one vector register: numbers for compiled kernels whose every operation acts on all of them.

A `Lanes` holds one float64 for each of WIDTH scenes, a `Mask` one truth. Within a kernel they are written like
numbers (`a + b * c`, `a < b`); `fma(a, b, c)` is a b + c rounded once. Nothing else is fused and no sum is
reordered, so what happens in one lane depends neither on the others nor on how wide the processor's registers are:
a scene has the same bits in any lane, beside any others. Where registers are narrower, the compiler splits.

Tables in memory are known to kernels by their addresses. An array would be counted whenever a function with
branches takes it, which costs more than what such functions do, and tables of lanes that differ in size do not fit
into one. Whoever passes an address keeps the array alive; how large it is is known on both sides.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable
from numpy.typing import NDArray

WIDTH = 8


class Lanes(types.Type):
    """One float64 a scene."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes[{WIDTH}]")


class Mask(types.Type):
    """One truth a scene."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask[{WIDTH}]")


def aligned(rows: int) -> NDArray[np.float64]:
    """Zeros, (rows, WIDTH), none of whose rows lies across lines of the processor's cache."""
    line = 8 * WIDTH
    room = np.zeros((rows + 1) * line, dtype=np.uint8)
    start = -room.ctypes.data % line
    return room[start : start + rows * line].view(np.float64).reshape(rows, WIDTH)


lanes, mask = Lanes(), Mask()
_VECTOR, _TRUTHS = ir.VectorType(ir.DoubleType(), WIDTH), ir.VectorType(ir.IntType(1), WIDTH)
_CELL = ir.IntType(32)


def _within(function: Callable[..., Any]) -> Any:
    """A function of compiled code only; what it takes there is not what Python sees."""
    return intrinsic(function)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _TRUTHS)


def _operation(
    symbol: Callable[..., Any], arguments: tuple[Any, ...], result: Any, build: Callable[..., Any]
) -> None:
    """Let an operator of Python act on lanes or masks."""

    @type_callable(symbol)
    def typed(context: Any) -> Callable[..., Any]:
        def of(*given: Any) -> Any:
            return result if given == arguments else None

        return of

    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return build(builder, *values)

    lower_builtin(symbol, *arguments)(lower)


_operation(operator.add, (lanes, lanes), lanes, lambda b, x, y: b.fadd(x, y))
_operation(operator.sub, (lanes, lanes), lanes, lambda b, x, y: b.fsub(x, y))
_operation(operator.mul, (lanes, lanes), lanes, lambda b, x, y: b.fmul(x, y))
_operation(operator.truediv, (lanes, lanes), lanes, lambda b, x, y: b.fdiv(x, y))
_operation(operator.neg, (lanes,), lanes, lambda b, x: b.fneg(x))
_operation(operator.lt, (lanes, lanes), mask, lambda b, x, y: b.fcmp_ordered("<", x, y))
_operation(operator.le, (lanes, lanes), mask, lambda b, x, y: b.fcmp_ordered("<=", x, y))
_operation(operator.gt, (lanes, lanes), mask, lambda b, x, y: b.fcmp_ordered(">", x, y))
_operation(operator.ge, (lanes, lanes), mask, lambda b, x, y: b.fcmp_ordered(">=", x, y))
_operation(operator.eq, (lanes, lanes), mask, lambda b, x, y: b.fcmp_ordered("==", x, y))
_operation(operator.and_, (mask, mask), mask, lambda b, x, y: b.and_(x, y))
_operation(operator.or_, (mask, mask), mask, lambda b, x, y: b.or_(x, y))
_operation(operator.invert, (mask,), mask, lambda b, x: b.not_(x))


def _at(builder: Any, values: Any, kind: Any) -> Any:
    """Pointer to a cell of a table: the first two values are the table and the place."""
    return builder.gep(builder.inttoptr(values[0], kind.as_pointer()), [values[1]])


@_within
def load(typing: Any, table: Any, row: Any) -> Any:
    """A row of a table (rows, WIDTH)."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load(_at(builder, values, _VECTOR), align=8)

    return lanes(types.int64, types.int64), build


@_within
def store(typing: Any, table: Any, row: Any, value: Any) -> Any:
    """Put lanes into a row of a table (rows, WIDTH)."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store(values[2], _at(builder, values, _VECTOR), align=8)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, lanes), build


@_within
def each(typing: Any, value: Any) -> Any:
    """The same number in every lane."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), values[0], _CELL(0))
        zeros = ir.Constant(ir.VectorType(_CELL, WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)

    return lanes(types.float64), build


def _called(name: str, count: int) -> Any:
    """A function of LLVM's own on lanes."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * count)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
        return builder.call(function, values)

    return build


@_within
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """A b + c, rounded once."""
    return lanes(lanes, lanes, lanes), _called("fma", 3)


@_within
def magnitude(typing: Any, a: Any) -> Any:
    """|a|."""
    return lanes(lanes), _called("fabs", 1)


@_within
def least(typing: Any, a: Any, b: Any) -> Any:
    """The smaller one."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", *values), *values)

    return lanes(lanes, lanes), build


@_within
def select(typing: Any, where: Any, a: Any, b: Any) -> Any:
    """A where it is true, elsewhere b."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(*values)

    return lanes(mask, lanes, lanes), build


@_within
def bits(typing: Any, truths: Any) -> Any:
    """The truths as a whole number, lane 0 in its last bit; zero where none is."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.zext(builder.bitcast(values[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.int64(mask), build


def _reader(kind: Any, result: Any, doc: str) -> Any:
    def read(typing: Any, table: Any, index: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load(_at(builder, values, kind))

        return result(types.int64, types.int64), build

    read.__doc__ = doc
    return _within(read)


def _writer(kind: Any, given: Any, doc: str) -> Any:
    def write(typing: Any, table: Any, index: Any, value: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            builder.store(values[2], _at(builder, values, kind))
            return context.get_dummy_value()

        return types.none(types.int64, types.int64, given), build

    write.__doc__ = doc
    return _within(write)


def _viewer(kind: Any, doc: str) -> Any:
    def view(typing: Any, table: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_data_type(kind).as_pointer())

        return types.CPointer(kind)(types.int64), build

    view.__doc__ = doc
    return _within(view)


number_at = _reader(ir.DoubleType(), types.float64, "A float64 of a table, by its place.")
whole_at = _reader(ir.IntType(64), types.int64, "An int64 of a table, by its place.")
put_number = _writer(ir.DoubleType(), types.float64, "Put a float64 into a table.")
put_whole = _writer(ir.IntType(64), types.int64, "Put an int64 into a table.")
numbers = _viewer(types.float64, "A table of float64 as `numba.carray` takes it.")
wholes = _viewer(types.int64, "A table of int64 as `numba.carray` takes it.")


@_within
def add_number(typing: Any, table: Any, index: Any, value: Any) -> Any:
    """Add to a float64 of a table."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        cell = _at(builder, values, ir.DoubleType())
        builder.store(builder.fadd(builder.load(cell), values[2]), cell)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.float64), build
