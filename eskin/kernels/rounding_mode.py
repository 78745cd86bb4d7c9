"""The processor's rounding mode: every proof here stands on rounding to nearest.

Some libraries leave the processor rounding upward once they are imported (codac does, by way of
gaol). Error-free transformations and proven polynomials are worth nothing then. So callers run
kernels within `rounding_to_nearest`, which costs next to nothing where the mode is right already.
"""

from __future__ import annotations

import ctypes
import functools
from typing import TYPE_CHECKING, Final, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

Given = ParamSpec("Given")
Result = TypeVar("Result")

_TO_NEAREST: Final = 0  # FE_TONEAREST
_C: Final = ctypes.CDLL(None)
_one = 1.0  # variables: the interpreter adds constants up beforehand
_half_above = 2.0**-53
_half_below = 2.0**-54


def rounds_to_nearest() -> bool:
    """Whether this thread's arithmetic rounds to nearest."""
    return _one + _half_above == _one == _one - _half_below


def rounding_to_nearest(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Let a function round to nearest, whatever its caller does; its caller's mode comes back."""

    @functools.wraps(function)
    def run(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        if rounds_to_nearest():
            return function(*args, **kwargs)
        mode = _C.fegetround()
        _C.fesetround(_TO_NEAREST)
        try:
            return function(*args, **kwargs)
        finally:
            _C.fesetround(mode)

    return run
