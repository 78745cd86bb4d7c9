"""The firmware's arithmetic, compiled: the same source, statement by statement, only faster.

Where the emulator runs faster than real time, or thousands of nodes, interpreting each sample
would take too long. Compiled without any licence to reorder, binary64 gives the same bits.
"""

from __future__ import annotations

import functools
import importlib
import math
import pkgutil
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

from eskin.kernels.jit import kernel, part
from eskin_sensor_node.firmware import arctangent, inversion, logarithm, rounding

if TYPE_CHECKING:
    from collections.abc import Callable

_MODULES = (
    *(rounding, logarithm, arctangent),
    *(
        importlib.import_module(f"{inversion.__name__}.{each.name}")
        for each in pkgutil.iter_modules(inversion.__path__)
    ),
)
"""All that calculates; no two have different things of one name."""


@functools.cache
def compiled_inversion() -> ModuleType:
    """A copy of `eskin_sensor_node.firmware.inversion` whose functions are machine code."""
    copy = ModuleType(inversion.__name__)
    shared: dict[str, Any] = vars(copy)
    shared["sqrt"] = math.sqrt
    for module in _MODULES:
        constants = ((name, value) for name, value in vars(module).items() if _is_number(value))
        shared.update(constants)
        for name, function in _own_functions(module):
            compile_ = kernel if name.startswith("measure_") else part
            shared[name] = compile_(_rebound(function, shared))
    return copy


def _own_functions(module: ModuleType) -> list[tuple[str, Callable[..., Any]]]:
    return [
        (name, value)
        for name, value in vars(module).items()
        if isinstance(value, FunctionType) and value.__module__ == module.__name__
    ]


def _is_number(value: object) -> bool:
    return type(value) in {int, float}


def _rebound(function: Callable[..., Any], names: dict[str, Any]) -> Callable[..., Any]:
    """The same code, which finds what it calls among other names."""
    copy = FunctionType(
        function.__code__, names, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__qualname__ = function.__qualname__
    copy.__module__ = function.__module__
    return copy
