"""Public payloads for any MQTT client: plain JSON with exact numbers and whole intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import orjson

from eskin.privacy import is_biometric
from eskin.union_bound import union_coverage
from eskin.wire import senml
from eskin.wire.messages import BlockSummary, Energy, Gap, Peak, Status
from eskin.wire.timestamp import format_timestamp
from eskin.wire.topics import live_topic, senml_topic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.wire import frames
    from eskin.wire.frames import Statements
    from eskin.wire.messages import Position
    from eskin_gateway.spool.descriptions import Skin


def is_public(message: BlockSummary | Peak) -> bool:
    """Whether a channel is not biometric."""
    return not is_biometric(message.channel)


def live(node: str, block: BlockSummary) -> tuple[str, bytes]:
    """Topic and JSON of a block's hull.

    ``t0`` is the earliest time of the first sample, ``t1`` the latest of the last. An infinite
    bound is null.
    """
    lo, hi = block.bounds
    body = orjson.dumps(
        {
            "t0": format_timestamp(block.time[0]),
            "t1": format_timestamp(block.time[1] + (block.n - 1) * block.dt),
            "lo": lo,  # orjson writes infinities as null
            "hi": hi,
            "unit": block.unit,
            "coverage": union_coverage(block.coverage, n=block.n),
            "n": block.n,
        }
    )
    return live_topic(node, block.channel), body


def live_senml(node: str, block: BlockSummary) -> Iterator[tuple[str, bytes]]:
    """Topic and SenML (RFC 8428) of a block's hull, which is valid for ``span`` s from its time.

    Nothing is yielded for a time before 1978, which SenML reads as relative to now.
    """
    t0 = block.time[0]
    if t0 < senml.EARLIEST:
        return
    t1 = block.time[1] + (block.n - 1) * block.dt
    coverage = union_coverage(block.coverage, n=block.n)
    extra = {
        "coverage": (coverage, senml.RATIO),
        "span": (senml.seconds(t1 - t0), senml.SECONDS),
    }
    lo, hi = block.bounds
    name = f"{node}/{block.channel}/"
    pack = senml.Pack(name, block.unit, t0, (0,), (lo,), (hi,), extra)
    yield senml_topic(node, block.channel), senml.as_json(pack)


def event(node: str, message: Peak | Gap) -> tuple[str, bytes]:
    """Topic and JSON of a peak or gap, with the fields of REST's ``/events``."""
    item = _event(node, message.position, message.time)
    item |= _peak(message) if isinstance(message, Peak) else {"detail": message.detail}
    return live_topic(node, "events"), orjson.dumps(item)


def statements(node: str, message: Statements, skin: Skin) -> Iterator[tuple[str, bytes]]:
    """Topic and JSON of each statement, with the fields of an event. Their ``id``s are numbered."""
    stated = [
        *((peak.time, _stated_peak(peak, skin.patches[peak.patch])) for peak in message.peaks),
        *((contact.time, _contact(contact)) for contact in message.contacts),
        *((verdict.time, _monitor_verdict(verdict)) for verdict in message.verdicts),
        *((gap.time, _stated_gap(gap, skin)) for gap in message.gaps),
    ]
    for number, (time, fields) in enumerate(stated):
        item = _event(node, message.position, time)
        item |= {"id": f"{item['id']}/{number}"} | fields
        yield live_topic(node, "events"), orjson.dumps(item)


def status(node: str, message: Status, *, online: bool) -> tuple[str, bytes]:
    """Topic and JSON of a node's status."""
    item: dict[str, Any] = {
        "node": node,
        "online": online,
        "time": {"lo": format_timestamp(message.time[0]), "hi": format_timestamp(message.time[1])},
        "boot": message.position.boot,
        "sequence": message.position.sequence,
        "profile": message.profile,
        "description": message.description,
        "uptime_ns": message.uptime,
        "outbox": {
            "messages": message.messages,
            "bytes": message.used,
            "capacity_bytes": message.capacity,
        },
        "gaps": message.gaps,
        "cause": None if message.cause is None else message.cause.label,
        "channels": [
            {"id": c.channel, "unit": c.unit, "dt": c.dt, "coverage": c.coverage}
            for c in message.channels
        ],
    }
    if message.faults is not None:
        item["faults"] = [
            {"taxel": fault.taxel}
            | {"dead": fault.dead.name.lower(), "stuck": fault.stuck.name.lower()}
            for fault in message.faults
        ]
    if message.energy is not None:
        item["energy"] = _energy(message.energy)
    return live_topic(node, "status"), orjson.dumps(item)


def _energy(energy: Energy) -> dict[str, Any]:
    return {
        "stored": {"lo": energy.stored[0], "hi": energy.stored[1]},
        "charge": {"lo": energy.charge[0], "hi": energy.charge[1]},
        "self_sustaining": energy.verdict.name.lower(),
        "shedding": energy.shedding.name.lower(),
    }


def _event(node: str, position: Position, time: tuple[int, int]) -> dict[str, Any]:
    return {
        "id": f"{node}/{position.boot}/{position.sequence}",
        "node": node,
        "channel": None,
        "kind": "gap",
        "verdict": None,
        "time": {"lo": format_timestamp(time[0]), "hi": format_timestamp(time[1])},
        "height": None,
        "prominence": None,
        "count": None,
        "unit": None,
        "coverage": None,
        "boot": position.boot,
        "sequence": position.sequence,
        "detail": None,
    }


def _stated_peak(peak: frames.Peak, patch: frames.Patch) -> dict[str, Any]:
    return {
        "channel": patch.channels[peak.column],
        "kind": "peak",
        "verdict": peak.verdict.name.lower(),
        "height": _interval(peak.height),
        "prominence": _interval(peak.prominence),
        "count": _interval(peak.counts),
        "unit": patch.unit,
        "coverage": peak.coverage,
    }


def _contact(contact: frames.Contact) -> dict[str, Any]:
    return {
        "kind": "contact",
        "verdict": contact.verdict.name.lower(),
        "count": _interval(contact.counts),
        "coverage": contact.coverage,
        "detail": {
            "label": contact.label,
            "cells": _interval(contact.cells),
            "force": _interval(contact.force),
            "centroid": [_interval(axis) for axis in contact.centroid],
            "links": [
                {"contact": link.contact, "verdict": link.verdict.name.lower()}
                for link in contact.links
            ],
        },
    }


def _monitor_verdict(verdict: frames.MonitorVerdict) -> dict[str, Any]:
    return {
        "kind": "verdict",
        "verdict": verdict.verdict.name.lower(),
        "coverage": verdict.coverage,
        "detail": {
            "monitor": verdict.monitor,
            "final": verdict.final,
            "because": [each.name.lower() for each in verdict.because if each.name],
        },
    }


def _stated_gap(gap: frames.Gap, skin: Skin) -> dict[str, Any]:
    return {
        "detail": {
            "reason": gap.reason,
            "messages": gap.messages,
            "samples": gap.samples,
            "patches": [skin.patches[number].patch_id for number in gap.patches],
        }
    }


def _peak(peak: Peak) -> dict[str, Any]:
    return {
        "channel": peak.channel,
        "kind": "peak",
        "verdict": peak.verdict.name.lower(),
        "height": _interval(peak.height),
        "prominence": _interval(peak.prominence),
        "count": _interval(peak.count),
        "unit": peak.unit,
        "coverage": peak.coverage,
    }


def _interval(bounds: tuple[float, float]) -> dict[str, float]:
    return {"lo": bounds[0], "hi": bounds[1]}
