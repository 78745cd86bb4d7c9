"""How eskin compiles: cached on disk, strict IEEE 754 arithmetic, no interpreter lock.

Never ``fastmath``: it would let the compiler reorder sums and drop infinities, and with them every
proof of enclosure.
"""

from __future__ import annotations

import functools
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
from numba import types
from numba.core.dispatcher import Dispatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

Function = TypeVar("Function", bound="Callable[..., Any]")


def kernel(function: Function) -> Function:
    """Compile a function at its first call with each new type of arguments; cache it on disk.

    What is cached is good as long as neither its own source nor that of a part in it changes.
    Where nothing can be written (a read-only container without ``NUMBA_CACHE_DIR``), each process
    compiles for itself.
    """
    made: Any = numba.njit(nogil=True, error_model="numpy")(function)
    try:
        made.enable_caching()
    except RuntimeError:  # numba found no folder to write to
        return cast("Function", made)
    # numba looks at the kernel's own file alone, and would keep old parts in new kernels.
    made._cache._cache_file._source_stamp = _Stamps(function)  # noqa: SLF001 - has no other way
    return cast("Function", made)


class _Stamps:
    """Name, time and size of the files that a kernel and the parts in it come from.

    Looked up when numba first asks: when a kernel is made, parts below it are still to come.
    """

    __hash__ = None  # type: ignore[assignment]  # files change

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __eq__(self, other: object) -> bool:
        return self._found == other

    def __reduce__(self) -> tuple[type, tuple[list[tuple[str, int, int]]]]:
        return list, (self._found,)

    @functools.cached_property
    def _found(self) -> list[tuple[str, int, int]]:
        known: set[Any] = set()
        waiting: list[Any] = [self._function]
        while waiting:
            each = waiting.pop()
            known.add(each)
            names = each.__code__.co_names
            used = [each.__globals__.get(name) for name in names]
            # Parts named by their module: the attribute's name stands beside the module's.
            modules = [value for value in used if isinstance(value, ModuleType)]
            used += [getattr(module, name, None) for module in modules for name in names]
            parts = (value.py_func for value in used if isinstance(value, Dispatcher))
            waiting += [found for found in parts if found not in known]
        files = sorted({each.__code__.co_filename for each in known})
        stats = ((name, Path(name).stat()) for name in files)
        return [(name, stat.st_mtime_ns, stat.st_size) for name, stat in stats]


def part(function: Function) -> Function:
    """Compile a small function for kernels to call; it dissolves into their loops."""
    made = numba.njit(nogil=True, error_model="numpy")(function)
    return cast("Function", _for_any_constant(made))


def inlined(function: Function) -> Function:
    """Compile a `part` that dissolves into its callers' loops however large it is.

    A loop with a call in it does not become vector instructions, and the compiler calls what it
    finds too large or too often used.
    """
    made = numba.njit(nogil=True, error_model="numpy", forceinline=True)(function)
    return cast("Function", _for_any_constant(made))


def _for_any_constant(made: Any) -> Any:
    """Have a part typed once for all constants that it is called with, and not for each anew."""
    find = made.get_call_template
    plain: Callable[[Any], Any] = types.unliteral

    def find_for_types(given: Sequence[Any], named: Mapping[str, Any]) -> Any:
        return find(tuple(map(plain, given)), {name: plain(named[name]) for name in named})

    made.get_call_template = find_for_types
    return made
