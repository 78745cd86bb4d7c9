"""How eskin compiles: cached on disk, strict IEEE 754 arithmetic, no interpreter lock.

Never ``fastmath``: it would let the compiler reorder sums and drop infinities, and with them every
proof of enclosure.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
from numba import types

from eskin.kernels.jit_cache import enable_cache

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

Function = TypeVar("Function", bound="Callable[..., Any]")


def kernel(function: Function) -> Function:
    """Compile a function at its first call with each new type of arguments; cache it on disk.

    What is cached is good as long as neither its own source nor that of a part in it changes. Of
    processes that need it at the same time one compiles, and the others wait for it. Where nothing
    can be written (a read-only container without ``NUMBA_CACHE_DIR``), each compiles for itself.
    """
    made = _compiler(no_cfunc_wrapper=True)(function)
    enable_cache(made)
    return cast("Function", made)


def part(function: Function) -> Function:
    """Compile a small function for kernels to call; it dissolves into their loops."""
    return _for_kernels(function)


def inlined(function: Function) -> Function:
    """Compile a `part` that dissolves into its callers' loops however large it is.

    A loop with a call in it does not become vector instructions, and the compiler calls what it
    finds too large or too often used.
    """
    return _for_kernels(function, forceinline=True)


def _compiler(**options: bool) -> Any:
    njit: Any = numba.njit  # its types lack two of the options
    return njit(nogil=True, error_model="numpy", **options)


def _for_kernels(function: Function, **options: bool) -> Function:
    """Have a part compiled once more for kernels, without the entries for Python.

    They would be compiled with each part and linked into each kernel. It is typed once for all
    constants that it is called with, and not for each anew.
    """
    made = _compiler(**options)(function)
    plain: Callable[[Any], Any] = types.unliteral

    @functools.cache
    def bare() -> Any:
        return _compiler(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)

    def find_for_types(given: Sequence[Any], named: Mapping[str, Any]) -> Any:
        return bare().get_call_template(
            tuple(map(plain, given)), {name: plain(named[name]) for name in named}
        )

    made.get_call_template = find_for_types
    made.get_overload = lambda signature: bare().get_overload(signature)
    return cast("Function", made)
