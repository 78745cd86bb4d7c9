"""What commands can ask for, in the words of robot skin (iCub's skinManager).

A *place* is what a setting belongs to: a channel (``t01.capacitance``), a taxel (``t01``), or the
whole node (``*``). A *state* holds the settings of each place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final, TypeAlias

from eskin.errors import CommandError
from eskin.wire.messages.header import CHANNEL

if TYPE_CHECKING:
    from collections.abc import Mapping

Value: TypeAlias = float | str
Arguments: TypeAlias = dict[str, Value]
State: TypeAlias = dict[str, dict[str, Value]]

WHOLE_NODE: Final = "*"
"""The place of what holds for all taxels."""
TAXEL: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,30}")


class CommandName(StrEnum):
    """Commands."""

    CALIBRATE = "calibrate"
    SET = "set"
    RESET = "reset"


class Mode(StrEnum):
    """What a node sends: every sample, peaks only, or as much as there is to tell."""

    SAMPLES = "samples"
    PEAKS = "peaks"
    ADAPTIVE = "adaptive"


@dataclass(frozen=True, slots=True)
class Range:
    """What a setting may be.

    Attributes:
        least: Least value.
        most: Greatest value.
        help: What it is, with its unit.
    """

    least: float
    most: float
    help: str

    def check(self, field: str, value: object) -> float:
        """Check a number.

        Raises:
            CommandError: It is none, or out of range.
        """
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise CommandError(field, value, f"a number from {self.least:g} to {self.most:g}")
        if not self.least <= value <= self.most:
            raise CommandError(field, value, f"{self.least:g} to {self.most:g}")
        return float(value)


RANGES: Final = {
    "threshold": Range(1e-30, 1e30, "least prominence of a peak, in the channel's unit"),
    "gain": Range(1e-3, 1e3, "gain of the chain, as a factor"),
    "smoothing": Range(0.0, 0.99, "weight of the past in each sample, 0 for none"),
    "rate": Range(1e-3, 1e6, "samples in a second"),
}
"""Settings that are numbers; ``mode`` and ``adaptive`` are not."""
SWITCH: Final = ("on", "off")
SETTINGS: Final = (*RANGES, "mode", "adaptive")

_ALLOWED: Final = {
    CommandName.CALIBRATE: ("taxel",),
    CommandName.SET: (*SETTINGS, "taxel", "channel"),
    CommandName.RESET: (),
}


def check_arguments(name: CommandName, arguments: Mapping[str, object]) -> Arguments:
    """Check a command's arguments.

    - ``calibrate``: a ``taxel``; none means all.
    - ``set``: a ``threshold`` with its ``channel``; or any of ``gain``, ``smoothing``, ``rate``,
      ``mode`` and ``adaptive``, of one ``taxel`` or of all.
    - ``reset``: nothing.

    Returns:
        The arguments, their numbers as floats.

    Raises:
        CommandError: One is not allowed, or one is missing.
    """
    allowed = _ALLOWED[name]
    for field, value in arguments.items():
        if field not in allowed:
            raise CommandError(field, value, f"{name} takes {', '.join(allowed) or 'nothing'}")
    checked = {field: _check(field, value) for field, value in arguments.items()}
    if name is CommandName.SET:
        _require_fitting(checked)
    return checked


def place_of(arguments: Mapping[str, Value]) -> str:
    """The place that a command's arguments speak of."""
    return str(arguments.get("channel", arguments.get("taxel", WHOLE_NODE)))


def _check(field: str, value: object) -> Value:
    if field in RANGES:
        return RANGES[field].check(field, value)
    if field == "mode":
        if value not in Mode.__members__.values():
            raise CommandError(field, value, ", ".join(Mode))
        return str(value)
    if field == "adaptive":
        if value not in SWITCH:
            raise CommandError(field, value, ", ".join(SWITCH))
        return str(value)
    pattern = CHANNEL if field == "channel" else TAXEL
    if not isinstance(value, str) or pattern.fullmatch(value) is None:
        example = "t01.capacitance" if field == "channel" else "t01"
        raise CommandError(field, value, f"a {field} such as {example}")
    return value


def _require_fitting(arguments: Arguments) -> None:
    """A threshold has its channel's unit; everything else belongs to a taxel as a whole."""
    settings = [field for field in arguments if field in SETTINGS]
    if not settings:
        raise CommandError("arguments", None, f"set takes at least one of {', '.join(SETTINGS)}")
    if "threshold" in arguments:
        if "channel" not in arguments:
            raise CommandError("channel", None, "a threshold needs its channel")
        if set(arguments) != {"threshold", "channel"}:
            others = ", ".join(sorted(set(arguments) - {"threshold", "channel"}))
            raise CommandError(others, None, "a threshold comes with its channel alone")
    elif "channel" in arguments:
        raise CommandError(
            "channel", arguments["channel"], f"{settings[0]} is of a taxel, or of the whole node"
        )
