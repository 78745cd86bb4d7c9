"""Feeds the kernels of the models: parameters and times broadcast, in blocks that fit the cache.

A model broadcasts its parameters as numpy does, taxels × times say. A kernel sees two axes only:
every operand either varies along an axis or is constant there. It takes one block of a row after
the other: `load` copies what varies, keeps what is constant, and checks that all values are
allowed. So each model writes one plain loop over contiguous numbers, which the compiler turns into
vector instructions, and no parameter is ever spread out in memory.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.kernels.jit import part
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.models.parameters import Floats, Parameter

BLOCK: Final = 2048
"""Elements in a block: a dozen operands of them fit a level-1 cache."""
_SHORT_ROW: Final = 32
"""Rows shorter than this cost more to begin than to work through."""

Operands: TypeAlias = "tuple[Floats, ...]"
Results: TypeAlias = "tuple[Floats, ...]"
Kernel: TypeAlias = "Callable[[Operands, Floats, int, Results], bool]"
"""``kernel(operands, limits, columns, out) -> whether all values were allowed``.

``operands`` are the lower and upper bounds of each parameter in turn, each (1 or rows) × (1 or
columns); ``limits`` what is allowed in each; ``out`` takes the lower and
upper bounds of each result in turn, flat.
"""


@part
def block_count(columns: int, out: Results) -> int:
    """How many blocks a kernel has to `load`."""
    return (out[0].size // max(columns, 1)) * ((columns + BLOCK - 1) // BLOCK)


@part
def load(
    operands: Operands, limits: Floats, columns: int, block: int, work: Floats
) -> tuple[int, int, bool]:
    """Copy one block of all operands into the rows of ``work``.

    Returns:
        Where the block starts in ``out``, its length, and whether all of its values are allowed.
    """
    blocks_per_row = (columns + BLOCK - 1) // BLOCK
    row = block // blocks_per_row
    first = (block - row * blocks_per_row) * BLOCK
    n = min(BLOCK, columns - first)
    allowed = True
    for k in range(len(operands)):
        operand, limit = operands[k], limits[k]
        from_row = row if operand.shape[0] > 1 else 0
        if operand.shape[1] > 1:
            allowed &= _copy(operand[from_row, first : first + n], limit, work[k])
        elif first == 0 and from_row == row:
            x = operand[from_row, 0]
            allowed &= _is_allowed(x, limit[0], limit[1], limit[2])
            work[k, : min(BLOCK, columns)] = x
    return row * columns + first, n, allowed


@part
def _is_allowed(x: float, least: float, greatest: float, besides: float) -> bool:
    return ((x >= least) & (x <= greatest)) | (x == besides)


@part
def _copy(source: Floats, limit: Floats, target: Floats) -> bool:
    least, greatest, besides = limit[0], limit[1], limit[2]
    allowed = True
    for i in range(source.size):
        x = source[i]
        target[i] = x
        allowed &= _is_allowed(x, least, greatest, besides)
    return allowed


@part
def row_of(
    operands: Operands, k: int, columns: int, block: int, work: Floats
) -> tuple[Floats, int]:
    """One block of one operand, without a copy where it varies; and where the block starts.

    For a kernel of few operands that spends its time on memory. It checks the values itself.
    """
    blocks_per_row = (columns + BLOCK - 1) // BLOCK
    row = block // blocks_per_row
    first = (block - row * blocks_per_row) * BLOCK
    n = min(BLOCK, columns - first)
    operand = operands[k]
    from_row = row if operand.shape[0] > 1 else 0
    if operand.shape[1] > 1:
        return operand[from_row, first : first + n], row * columns + first
    if first == 0 and from_row == row:
        work[k, : min(BLOCK, columns)] = operand[from_row, 0]
    return work[k, :n], row * columns + first


@rounding_to_nearest
def evaluate(kernel: Kernel, parameters: Sequence[Parameter], results: int) -> list[Interval]:
    """Run a kernel over the broadcast parameters.

    Args:
        kernel: What a model computes.
        parameters: In the order in which the kernel knows them.
        results: How many quantities it gives.

    Returns:
        One array of intervals for each quantity, of the broadcast shape.

    Raises:
        IntervalError: The shapes do not fit each other, or a value is not allowed.
    """
    shape = broadcast_shape(parameters)
    operands, columns = _fold([b for p in parameters for b in (p.inf, p.sup)], shape)
    limits = np.array([p.allowed.row for p in parameters for _ in ("inf", "sup")])
    found = [np.empty((2, math.prod(shape))) for _ in range(results)]
    out = tuple(bound for pair in found for bound in pair)
    if not kernel(operands, limits, columns, out):
        for each in parameters:
            each.require_allowed()
    return [
        Interval._trusted(inf.reshape(shape), sup.reshape(shape))  # noqa: SLF001 - inf <= sup
        for inf, sup in found
    ]


def broadcast_shape(parameters: Sequence[Parameter]) -> tuple[int, ...]:
    """The shape that all parameters broadcast to.

    Raises:
        IntervalError: There is none.
    """
    shapes = {p.inf.shape for p in parameters}
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        named = ", ".join(f"{p.name} {p.inf.shape}" for p in parameters if p.inf.shape)
        raise IntervalError(f"shapes do not fit each other: {named}") from error


def _fold(arrays: list[Floats], shape: tuple[int, ...]) -> tuple[Operands, int]:
    """Two axes for the kernel out of any number; spreads out only what has no such form."""
    size = math.prod(shape)
    if all(a.size == 1 or a.shape == shape for a in arrays):
        return tuple(_frozen(a, 1, a.size) for a in arrays), size
    padded = [a.reshape((1,) * (len(shape) - a.ndim) + a.shape) for a in arrays]
    costs = [_cost(padded, shape, split) for split in range(len(shape) + 1)]
    split = int(np.argmin(costs))
    return tuple(_two_axes(a, shape, split) for a in padded), math.prod(shape[split:])


def _cost(padded: list[Floats], shape: tuple[int, ...], split: int) -> float:
    """Elements to spread out, and a fine for rows that are many and short."""
    rows, columns = math.prod(shape[:split]), math.prod(shape[split:])
    spread = sum(rows * columns for a in padded if not _fits(a, shape, split))
    short = rows > 1 and columns < _SHORT_ROW
    return float(spread + (len(padded) * rows * _SHORT_ROW if short else 0) + rows / 2)


def _fits(array: Floats, shape: tuple[int, ...], split: int) -> bool:
    """Whether it varies along all or none of the axes on each side of the split."""
    head = array.shape[:split] in (shape[:split], (1,) * split)
    return head and array.shape[split:] in (shape[split:], (1,) * (len(shape) - split))


def _two_axes(array: Floats, shape: tuple[int, ...], split: int) -> Floats:
    if not _fits(array, shape, split):
        array = np.broadcast_to(array, shape)
    return _frozen(array, math.prod(array.shape[:split]), math.prod(array.shape[split:]))


def _frozen(array: Floats, rows: int, columns: int) -> Floats:
    """Contiguous, with two axes, and read-only: one type, whatever the caller handed in."""
    made = np.ascontiguousarray(array).reshape(rows, columns)
    made.flags.writeable = False
    return made
