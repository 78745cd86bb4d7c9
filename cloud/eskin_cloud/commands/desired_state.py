"""The desired state of a node: the settings that all commands since its last reset ask for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.wire.messages import CommandName
from eskin.wire.messages.command import (
    MONITOR_SETTINGS,
    NEVER,
    SETTINGS,
    WHOLE_NODE,
    place_of,
)

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments, State, Value


def merge_desired_state(desired_state: State, name: CommandName, arguments: Arguments) -> State:
    """The desired state after a command; settings of the whole node replace those of its taxels."""
    if name is CommandName.RESET:
        return {}
    if name is CommandName.MONITOR:
        place = place_of(arguments)
        others = {other: found for other, found in desired_state.items() if other != place}
        own: dict[str, Value] = {
            field: arguments[field] for field in MONITOR_SETTINGS if field in arguments
        }
        return others | {place: own}
    settings = {field: value for field, value in arguments.items() if field in SETTINGS}
    if not settings:
        return desired_state
    place = place_of(arguments)
    merged = {
        other: {
            field: value
            for field, value in found.items()
            if place != WHOLE_NODE or field not in settings
        }
        for other, found in desired_state.items()
    }
    merged[place] = merged.get(place, {}) | settings
    return {where: found for where, found in merged.items() if found}


def is_settled(desired_state: State, reported: State | None) -> bool:
    """Whether the reported state of a node has all settings of its desired state."""
    return all(
        _reports(reported or {}, desired_state, place, field, value)
        for place, settings in desired_state.items()
        for field, value in settings.items()
    )


def _reports(reported: State, desired_state: State, place: str, field: str, value: Value) -> bool:
    if field in reported.get(place, {}):
        return reported[place][field] == value
    if field == "on" and value == NEVER:
        return True  # of a monitor that it does not have
    if place != WHOLE_NODE:
        return False
    taxels = {taxel: found[field] for taxel, found in reported.items() if field in found}
    # A setting of a taxel overrides that of the whole node.
    return bool(taxels) and all(
        found == value
        for taxel, found in taxels.items()
        if field not in desired_state.get(taxel, {})
    )
