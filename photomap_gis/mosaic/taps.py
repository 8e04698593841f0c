"""A cubic look into a picture, as vector instructions: sixteen taps of three channels, lit and put down in one go.

Numba's loops over twelve neighbouring bytes stay scalar, at twice what OpenCV's remapping costs; said as vectors they
cost half of it. What is written here is LLVM's own language [1], which every processor it knows has instructions for.

Of a *row* of pixels between nodes this is carried from pixel to pixel, 8 numbers and their steps (``LANES``): factors
of blue, green and red, the place x in the picture, offsets of the three, the place y.

[1] LLVM Language Reference Manual: vector types.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import types
from numba.core.types.containers import UniTuple
from numba.extending import intrinsic

STEP_BITS = 6
STEPS = 1 << STEP_BITS
"""A pixel has so many places between it and the next: weights are kept for each."""

LANES = 8
AT_X, AT_Y = 3, 7
"""Which of the numbers that nodes hold are places in the picture."""

PATCH_STRIDE = 16
"""Bytes that one row of taps reads: twelve, and four that have no weight."""

_SHARPNESS = -0.75  # OpenCV's: keeps 1.01 of the gradient energy of aerial imagery; -0.5 keeps less

_FLOAT, _BYTE, _INT, _LONG = ir.FloatType(), ir.IntType(8), ir.IntType(32), ir.IntType(64)
_MAY_FUSE = ("contract",)


def cubic_weights() -> npt.NDArray[np.float32]:
    """``(STEPS, 4)`` weights of the pixels before, at, after and two after a place (Keys' kernel); they add up to 1."""
    t = np.arange(STEPS)[:, None] / STEPS
    d = np.abs(t - np.array([-1.0, 0.0, 1.0, 2.0]))
    a = _SHARPNESS
    near, far = ((a + 2.0) * d - (a + 3.0)) * d * d + 1.0, ((a * d - 5.0 * a) * d + 8.0 * a) * d - 4.0 * a
    return np.where(d <= 1.0, near, far).astype(np.float32)


def _of_bytes(weights: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """``(STEPS * 16,)`` the same for bytes: each weight three times, and four zeros."""
    wide = np.zeros((STEPS, PATCH_STRIDE), dtype=np.float32)
    wide[:, :12] = np.repeat(weights, 3, axis=1)
    return wide.reshape(-1)


DOWN = cubic_weights().reshape(-1)
ALONG = _of_bytes(cubic_weights())


@intrinsic  # type: ignore[untyped-decorator]
def begin_row(_: Any, nodes: Any, corners: Any, share: Any, row: Any) -> Any:
    """``begin_row(nodes, (upper left, upper right, lower left, lower right), share, row)``: numbers between nodes.

    ``nodes`` is flat float32, the corners are where their ``LANES`` begin; ``share`` of the lower ones is taken.
    ``row`` then holds the numbers at the left border and how much they grow to the right one.
    """

    def build(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        at = [b.extract_value(arguments[1], k) for k in range(4)]
        upper_left, upper_right, lower_left, lower_right = (
            _load(context, b, signature.args[0], arguments[0], i, ir.VectorType(_FLOAT, LANES)) for i in at
        )
        down = _splat(b, arguments[2], LANES)
        left = _sum(b, _product(b, _less(b, lower_left, upper_left), down), upper_left)
        right = _sum(b, _product(b, _less(b, lower_right, upper_right), down), upper_right)
        out = signature.args[3], arguments[3]
        _store(context, b, *out, ir.Constant(_LONG, 0), left)
        _store(context, b, *out, ir.Constant(_LONG, LANES), _less(b, right, left))
        return context.get_dummy_value()

    return types.void(nodes, UniTuple(types.int64, 4), types.float32, row), build


@intrinsic  # type: ignore[untyped-decorator]
def put(_: Any, picture: Any, tap: Any, row: Any, share: Any, out: Any, at: Any) -> Any:
    """``put(picture, tap, row, share, out, at)``: draw a pixel as RGBA, opaque, at ``out[at]``.

    ``tap`` is ``(first byte, bytes to the next row, step down, step along)``; ``share`` is how far along the row it is.
    """

    def build(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        value = _lit(context, b, signature.args, arguments)
        zero, half, most = (ir.Constant(value.type, [v] * 4) for v in (0.0, 0.5, 255.0))
        value = b.select(b.fcmp_ordered(">", value, zero), value, zero)
        value = _sum(b, b.select(b.fcmp_ordered("<", value, most), value, most), half)
        whole = b.trunc(b.fptoui(value, ir.VectorType(_INT, 4)), ir.VectorType(_BYTE, 4))
        opaque = ir.Constant(whole.type, [255] * 4)
        rgba = b.shuffle_vector(whole, opaque, ir.Constant(ir.VectorType(_INT, 4), [2, 1, 0, 4]))
        _store(context, b, signature.args[4], arguments[4], arguments[5], rgba)
        return context.get_dummy_value()

    four = UniTuple(types.int64, 4)
    return types.void(picture, four, row, types.float32, out, types.int64), build


@intrinsic  # type: ignore[untyped-decorator]
def add(_: Any, picture: Any, tap: Any, row: Any, share: Any, out: Any, at: Any, weight: Any) -> Any:
    """``add(picture, tap, row, share, out, at, weight)``: add a weighted pixel, BGR and the weight, to float32 there.

    The first four arguments are those of ``put``.
    """

    def build(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        value = _lit(context, b, signature.args, arguments)
        value = b.insert_element(value, ir.Constant(_FLOAT, 1.0), ir.Constant(_INT, 3))
        kind, sums, where = signature.args[4], arguments[4], arguments[5]
        before = _load(context, b, kind, sums, where, value.type)
        _store(context, b, kind, sums, where, _sum(b, _product(b, value, _splat(b, arguments[6], 4)), before))
        return context.get_dummy_value()

    four = UniTuple(types.int64, 4)
    return types.void(picture, four, row, types.float32, out, types.int64, types.float32), build


def _lit(context: Any, b: Any, kinds: Any, arguments: Any) -> Any:
    """Return ``<4 x float>``: the cubic mean of a picture's taps by channel, times its factor, and its offset added."""
    picture, tap, row, share = arguments[:4]
    first, stride, down, along = (b.extract_value(tap, k) for k in range(4))
    wide = ir.VectorType(_FLOAT, PATCH_STRIDE)
    total = None
    for k in range(4):
        where = b.add(first, b.mul(stride, ir.Constant(_LONG, k)))
        taps = b.uitofp(_load(context, b, kinds[0], picture, where, ir.VectorType(_BYTE, PATCH_STRIDE)), wide)
        weight = _weight(b, DOWN, b.add(b.mul(down, ir.Constant(_LONG, 4)), ir.Constant(_LONG, k)), _FLOAT)
        part = _product(b, taps, _splat(b, weight, PATCH_STRIDE))
        total = part if total is None else _sum(b, part, total)
    total = _product(b, total, _weight(b, ALONG, b.mul(along, ir.Constant(_LONG, PATCH_STRIDE)), wide))
    six = _sum(b, _part(b, total, 0, 8), _part(b, total, 6, 8))  # byte k and k + 6
    pixel = _sum(b, _part(b, six, 0, 4), _part(b, six, 3, 4))
    kind = ir.VectorType(_FLOAT, LANES)
    start, growth = (_load(context, b, kinds[2], row, ir.Constant(_LONG, k), kind) for k in (0, LANES))
    light = _sum(b, _product(b, growth, _splat(b, share, LANES)), start)
    return _sum(b, _product(b, pixel, _part(b, light, 0, 4)), _part(b, light, 4, 4))


def _weight(b: Any, table: npt.NDArray[np.float32], index: Any, kind: Any) -> Any:
    """Return what a table of weights holds from an index on; the table becomes part of the machine code."""
    name = f"cubic_weights_{len(table)}"
    held = b.module.globals.get(name)
    if held is None:
        values = ir.Constant(ir.ArrayType(_FLOAT, len(table)), [float(v) for v in table])
        held = ir.GlobalVariable(b.module, values.type, name)
        held.initializer, held.linkage, held.global_constant = values, "internal", True
    there = b.gep(held, [ir.Constant(_LONG, 0), index])
    return b.load(b.bitcast(there, kind.as_pointer()), align=4)


def _place(context: Any, b: Any, kind: Any, array: Any, index: Any, as_kind: Any) -> Any:
    data = context.make_array(kind)(context, b, array).data
    return b.bitcast(b.gep(data, [index]), as_kind.as_pointer())


def _load(context: Any, b: Any, kind: Any, array: Any, index: Any, as_kind: Any) -> Any:
    return b.load(_place(context, b, kind, array, index, as_kind), align=kind.dtype.bitwidth // 8)


def _store(context: Any, b: Any, kind: Any, array: Any, index: Any, value: Any) -> None:
    b.store(value, _place(context, b, kind, array, index, value.type), align=kind.dtype.bitwidth // 8)


def _splat(b: Any, value: Any, count: int) -> Any:
    kind = ir.VectorType(value.type, count)
    one = b.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_INT, 0))
    return b.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INT, count), [0] * count))


def _part(b: Any, value: Any, first: int, count: int) -> Any:
    return b.shuffle_vector(value, value, ir.Constant(ir.VectorType(_INT, count), list(range(first, first + count))))


def _product(b: Any, x: Any, y: Any) -> Any:
    return b.fmul(x, y, flags=_MAY_FUSE)


def _sum(b: Any, x: Any, y: Any) -> Any:
    return b.fadd(x, y, flags=_MAY_FUSE)


def _less(b: Any, x: Any, y: Any) -> Any:
    return b.fsub(x, y, flags=_MAY_FUSE)
