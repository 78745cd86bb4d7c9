"""Monitors that run on a node, and what follows from their latest verdicts."""

from collections.abc import Mapping
from typing import Final, Literal

import orjson
from pydantic import BaseModel
from sqlalchemy import RowMapping

from eskin.wire.messages.command import MONITOR_PLACE, NEVER, ON, OUTPUTS
from eskin_cloud.schemas.alarms import VerdictName
from eskin_cloud.schemas.base import Row, TimeDocument, time_span

Settings = dict[str, float | str]

_STRENGTH: Final = {"impossible": 0, "possible": 1, "certain": 2}
_NO_OUTPUT: Final = "none"


class StatedVerdictDocument(BaseModel):
    """What a node stated last of a monitor: its verdict from the instant ``time`` on.

    ``final`` is whether no later sample can change it, ``because`` why it is possible, ``coverage``
    the probability with which it holds, at least. ``current`` is whether it holds still, by all
    that has come: the node is online, and has not started anew.
    """

    verdict: VerdictName
    time: TimeDocument
    final: bool
    because: list[Literal["width", "instant", "gap", "pending"]]
    coverage: float
    current: bool


class NodeMonitorDocument(BaseModel):
    """A monitor that runs on a node, or is to run there.

    ``formula``, ``on`` and ``output`` are those with which it runs; before the node reports them,
    those that are desired. ``latest`` is null before its first verdict, and where the node's
    statements are sealed. ``level`` is that of its output, which is on while any monitor of that
    output asks for it. It is null where the monitor drives none, and where the level is not known
    now: one of its monitors has no current verdict.
    """

    name: str
    formula: str
    on: Literal["possible", "certain"]
    output: Literal["none", "stop", "out1", "out2", "out3"]
    desired: Settings | None
    reported: Settings | None
    latest: StatedVerdictDocument | None
    level: Literal["on", "off"] | None


def describe_node_monitors(
    state: Row | None, stated: Mapping[str, RowMapping], *, boot: int, online: bool
) -> list[NodeMonitorDocument]:
    """All monitors of a node, by name.

    Args:
        state: Its row of desired and reported settings.
        stated: Its latest verdicts, by monitor.
        boot: The start of it that is known last.
        online: Whether it is heard of.
    """
    desired, reported = (_monitors(None if state is None else state[each])
                         for each in ("desired", "reported"))  # fmt: skip
    latest = {name: _describe(row, current=online and row["boot"] == boot)
              for name, row in stated.items()}  # fmt: skip
    asked: dict[object, list[bool | None]] = {}
    for name, settings in reported.items():
        asked.setdefault(settings.get("output"), []).append(_asks(latest.get(name), settings))
    found = []
    for name in sorted(desired.keys() | reported.keys()):
        settings = reported.get(name) or desired[name]
        level = _level(asked[settings.get("output")]) if name in reported else None
        document = {
            "name": name,
            **{field: settings.get(field) for field in ("formula", "on", "output")},
            "desired": desired.get(name),
            "reported": reported.get(name),
            "latest": latest.get(name),
            "level": None if settings.get("output") == _NO_OUTPUT else level,
        }
        found.append(NodeMonitorDocument.model_validate(document))
    return found


def _monitors(state: str | None) -> dict[str, Settings]:
    """The monitors that a state holds, without those that do not run, or not as nodes run them."""
    places: dict[str, Settings] = orjson.loads(state or "{}")
    return {
        place.removeprefix(MONITOR_PLACE): settings
        for place, settings in places.items()
        if place.startswith(MONITOR_PLACE)
        and isinstance(settings.get("formula"), str)
        and settings.get("on") in {*ON} - {NEVER}
        and settings.get("output") in OUTPUTS
    }


def _asks(stated: StatedVerdictDocument | None, settings: Settings) -> bool | None:
    """Whether a monitor asks for its output now; ``None``: that is not known."""
    if stated is None or not stated.current:
        return None
    return _STRENGTH[stated.verdict] >= _STRENGTH[str(settings["on"])]


def _level(asked: list[bool | None]) -> Literal["on", "off"] | None:
    """The level of an output, of which each monitor asks something, or it is unknown what."""
    if any(asked):
        return "on"
    return None if None in asked else "off"


def _describe(row: RowMapping, *, current: bool) -> StatedVerdictDocument:
    return StatedVerdictDocument(
        verdict=row["verdict"],
        time=time_span(row["t_lo"], row["t_hi"]),
        coverage=row["coverage"],
        current=current,
        **{name: value for name, value in orjson.loads(row["detail"]).items() if name != "monitor"},
    )
