"""Runs compiled loops over intervals of any shape."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.conversion import as_compiled
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.interval.bounds import Bounds
    from eskin.interval.conversion import Floats

Pair = tuple["Floats", "Floats"]


@rounding_to_nearest
def of_one(loop: Callable[..., None], x: Bounds, *more: Any) -> Pair:
    """A function of one interval."""
    lo, hi = np.empty(x.shape), np.empty(x.shape)
    loop(_flat(x.inf), _flat(x.sup), *more, lo.reshape(-1), hi.reshape(-1))
    return lo, hi


@rounding_to_nearest
def of_two(loop: Callable[..., None], x: Bounds, y: Bounds) -> Pair:
    """A function of two intervals, which are broadcast."""
    shape = _common(x, y)
    lo, hi = np.empty(shape), np.empty(shape)
    loop(*_operand(x, shape), *_operand(y, shape), lo.reshape(-1), hi.reshape(-1))
    return lo, hi


@rounding_to_nearest
def of_three(loop: Callable[..., None], x: Bounds, y: Bounds, z: Bounds) -> Pair:
    """A function of three intervals, which are broadcast."""
    shape = _common(x, y, z)
    lo, hi = np.empty(shape), np.empty(shape)
    spread = [
        _flat(side if side.shape == shape else np.broadcast_to(side, shape))
        for each in (x, y, z)
        for side in (each.inf, each.sup)
    ]
    loop(*spread, lo.reshape(-1), hi.reshape(-1))
    return lo, hi


def _common(*operands: Bounds) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*(operand.shape for operand in operands))
    except ValueError as error:
        raise IntervalError(f"these intervals do not fit each other: {error}") from error


def _operand(x: Bounds, shape: tuple[int, ...]) -> tuple[Floats, Floats, int]:
    """Flat bounds, and the step to the next: 0 for one interval that serves all."""
    if x.size == 1:
        return _flat(x.inf), _flat(x.sup), 0
    if x.shape == shape:
        return _flat(x.inf), _flat(x.sup), 1
    return _flat(np.broadcast_to(x.inf, shape)), _flat(np.broadcast_to(x.sup, shape)), 1


def _flat(array: Floats) -> Floats:
    return as_compiled(array).reshape(-1)
