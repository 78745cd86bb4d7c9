"""A number that counts what is done with it."""

from __future__ import annotations

from typing import Any, Final

_ARITHMETIC: Final = ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv")
_OTHERS: Final = ("neg", "abs", "lt", "le", "gt", "ge", "eq", "ne")


class Counted(float):
    """A float; `done` counts operations and comparisons of all of them."""

    done = 0
    __hash__ = float.__hash__

    def __index__(self) -> int:
        return int(self)

    def __mod__(self, other: float) -> Counted:
        return Counted(float(self) % other)


def _counting(name: str) -> Any:
    plain = getattr(float, name)

    def operation(self: Counted, *others: float) -> Any:
        Counted.done += 1
        result = plain(self, *others)
        return Counted(result) if type(result) is float else result

    return operation


for _name in (*_ARITHMETIC, *_OTHERS):
    setattr(Counted, f"__{_name}__", _counting(f"__{_name}__"))
