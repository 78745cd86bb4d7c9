"""Machine instructions that numba does not offer by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray


def _fma(_typing: Any, _a: Any, _b: Any, _c: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def _bitcast(given: Any, found: Any, kind: ir.Type) -> Any:
    """The same bits as a number of another type, which the compiler calls ``kind``."""

    def cast_bits(_typing: Any, _value: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], kind)

        return found(given), generate

    return intrinsic(cast_bits)


def _load(_typing: Any, data: Any, place: Any, index: Any, kind: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start = context.make_array(data)(context, builder, arguments[0]).data
        pointer = context.get_value_type(signature.return_type).as_pointer()
        first = builder.bitcast(builder.gep(start, [arguments[1]]), pointer)
        return builder.load(builder.gep(first, [arguments[2]]), align=1)

    return kind.dtype(data, place, index, kind), generate


fma: Final = cast("Callable[[float, float, float], float]", intrinsic(_fma))
"""``a·b + c``, rounded once."""
to_bits: Final = cast(
    "Callable[[float], int]", _bitcast(types.float64, types.int64, ir.IntType(64))
)
"""The bits of a float as an integer."""
from_bits: Final = cast(
    "Callable[[int], float]", _bitcast(types.int64, types.float64, ir.DoubleType())
)
"""The float that has these bits."""
to_bits32: Final = cast(
    "Callable[[np.float32], np.uint32]", _bitcast(types.float32, types.uint32, ir.IntType(32))
)
"""The bits of a binary32 as an integer."""
from_bits32: Final = cast(
    "Callable[[np.uint32], np.float32]", _bitcast(types.uint32, types.float32, ir.FloatType())
)
"""The binary32 that has these bits."""
load: Final = cast(
    "Callable[[bytes | NDArray[np.uint8], int, int, type[Any]], Any]", intrinsic(_load)
)
"""The index-th number of a kind in bytes, from a place on that need not be aligned; unchecked."""
