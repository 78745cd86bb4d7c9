"""Scenario files: packaged ones by their name, others by their path."""

from __future__ import annotations

import tomllib
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from eskin.errors import ScenarioError, shown, unprefixed
from eskin_sensor_node.world.scenario.events import NoiseEvent
from eskin_sensor_node.world.scenario.script import Script

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_sensor_node.world.scenario.events import AnyEvent

_LONGEST_PLACE: Final = 200
"""As errors show it: a key may be anything."""
_KEPT: Final = 16
"""Scenarios that are kept: every taxel of a node asks for its own, and more than once."""


@cache
def scenario_names() -> tuple[str, ...]:
    """File names of the packaged scenarios."""
    found = files("eskin_sensor_node").joinpath("scenarios").iterdir()
    return tuple(sorted(entry.name for entry in found if entry.name.endswith(".toml")))


def read_scenario(name: str) -> Script:
    """Read a scenario.

    Args:
        name: Path of a TOML file, or the name of a packaged one, such as ``hand.toml``.

    Raises:
        ScenarioError: It cannot be read or played. It names file, place and reason.
    """
    return _read(name, scenario_text(name))


@lru_cache(maxsize=_KEPT)
def _read(name: str, text: str) -> Script:
    tables = _tables(name, text)
    try:
        script = Script.model_validate(tables)
    except ValidationError as error:
        raise refusal(name, error) from error
    for place, reason in _contradictions(script):
        raise ScenarioError(name, place, reason)
    return script


def scenario_text(name: str) -> str:
    """The text of a scenario's file.

    Raises:
        ScenarioError: It cannot be read.
    """
    packaged = name in scenario_names()
    source = files("eskin_sensor_node").joinpath("scenarios", name) if packaged else Path(name)
    try:
        return source.read_bytes().decode()
    except OSError as error:
        known = ", ".join(scenario_names())
        raise ScenarioError(
            name, "file", f"it cannot be read: {error.strerror}; packaged scenarios: {known}"
        ) from error
    except UnicodeDecodeError as error:
        raise ScenarioError(name, "file", f"it is no text in UTF-8: {error}") from error


def _tables(name: str, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # Also integers of thousands of digits, and arrays in arrays in arrays.
        raise ScenarioError(name, "file", f"it is no TOML that can be read: {error}") from error


def _contradictions(script: Script) -> Iterator[tuple[str, str]]:
    """What no single table can know: place and reason."""
    known = script.skin.build().numbers
    first, last = next(iter(known)), list(known)[-1]
    for number, event in enumerate(script.event):
        place = _event(number, event.kind)
        for taxel in event.taxels:
            if taxel not in known:
                key = "path" if event.kind == "slide" else "at"
                yield f"{place}.{key}", _absent(taxel, first, last)
        if event.end_s > script.duration_s:
            reason = f"it ends at {event.end_s:g} s, after duration_s = {script.duration_s:g}"
            yield place, reason
    for key in ("fault", "wear", "film"):
        for number, each in enumerate(getattr(script, key)):
            if each.taxel not in known:
                yield f"{key} {number + 1}.taxel", _absent(each.taxel, first, last)
    yield from _disturbed(script)


def _disturbed(script: Script) -> Iterator[tuple[str, str]]:
    """Stretches of noise only in which something happens."""
    slack = script.variation.time_s
    quiet = [
        (number, begin, begin + event.duration_s)
        for number, event in enumerate(script.event)
        if isinstance(event, NoiseEvent)
        for begin in event.begins
    ]
    loud = [pair for pair in enumerate(script.event) if not isinstance(pair[1], NoiseEvent)]
    for number, begin, end in quiet:
        for other, event in loud:
            if _meets(event, begin - slack, end + slack):
                reason = f"{_event(other, event.kind)} happens in it (variation.time_s included)"
                yield _event(number, "noise"), reason


def _meets(event: AnyEvent, begin: float, end: float) -> bool:
    return any(start < end and start + event.duration_s > begin for start in event.begins)


def _absent(taxel: str, first: str, last: str) -> str:
    return f"taxel '{taxel}' is not there; the skin has {first} to {last}"


def _event(number: int, kind: str) -> str:
    return f"event {number + 1} ({kind})"


def refusal(name: str, error: ValidationError, *, within: str = "") -> ScenarioError:
    """One line about the first thing that is wrong.

    Args:
        name: The file.
        error: What pydantic found.
        within: The table in which it was looking; empty for the whole file.
    """
    first = error.errors(include_url=False)[0]
    place = _place((within, *first["loc"]) if within else first["loc"])
    if first["type"] == "missing":
        return ScenarioError(name, place, "it is missing; it has no default")
    if first["type"] == "extra_forbidden":
        return ScenarioError(name, place, "no such key; check its spelling")
    if first["type"] == "value_error" and isinstance(first["input"], dict):
        return ScenarioError(name, place, str(first["ctx"]["error"]))
    reason = unprefixed(first["msg"])
    return ScenarioError(name, place, f"{shown(first['input'])} is not allowed: {reason}")


def _place(location: tuple[int | str, ...]) -> str:
    """``event 3 (tap).force_N``: numbers as people count, the kind of a table in brackets."""
    text = ""
    for before, part in zip(("", *location), location, strict=False):
        if isinstance(part, int):
            text += f" {part + 1}"
        elif before == "skin" or (isinstance(before, int) and location[0] == "event"):
            text += f" ({part})" if len(location) > 2 or before == "skin" else f".{part}"
        else:
            text += f".{part}" if text else part
    return text[:_LONGEST_PLACE] or "scenario"
