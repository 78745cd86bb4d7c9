"""All public messages for any MQTT client: hulls, statements and status.

Plain JSON with exact numbers and whole intervals, and SenML (RFC 8428).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import orjson

from eskin.wire.senml import EARLIEST, RATIO, SECONDS, Pack, as_json, seconds
from eskin.wire.timestamp import format_timestamp
from eskin.wire.topics import live_topic, senml_topic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.wire import frames
    from eskin.wire.frames import DescribedLayout, Statements
    from eskin.wire.messages import Energy, Position, Status
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.publish.frame_hulls import PublishedHull


def hulls(node: str, hull: PublishedHull, *, senml: bool) -> Iterator[Publication]:
    """The hull of a patch: of each of its channels, or of a large skin's patch as a whole.

    ``t0`` is the earliest time of the first sample, ``t1`` the latest of the last. An infinite
    bound is null.

    Args:
        node: The node.
        hull: What to publish.
        senml: Whether it is published as SenML, too, unless its time is before 1978.
    """
    yield from _patch(node, hull) if hull.is_large else _channels(node, hull)
    if senml and hull.t0 >= EARLIEST:
        yield from _senml(node, hull)


def _channels(node: str, hull: PublishedHull) -> Iterator[Publication]:
    """JSON of each channel that was sampled."""
    lo, hi = (bounds.tolist() for bounds in hull.bounds)
    common = _common(hull)
    for column, channel in enumerate(hull.patch.channels):
        if hull.samples[column]:
            item = {**common, "lo": lo[column], "hi": hi[column], "n": int(hull.samples[column])}
            yield live_topic(node, channel), orjson.dumps(item), False


def _patch(node: str, hull: PublishedHull) -> Iterator[Publication]:
    lo, hi = hull.bounds
    item = {
        **_common(hull),
        "n": int(hull.samples.max()),
        "taxels": hull.patch.taxels,
        "lo": lo.tolist(),  # orjson writes infinities as null
        "hi": hi.tolist(),
        "hull": {
            "lo": float(lo.min()),
            "hi": float(hi.max()),
            "coverage": hull.coverage(len(lo)),
        },
        "contact": hull.contact,
    }
    yield live_topic(node, f"patches/{hull.patch.patch_id}"), orjson.dumps(item), False


def _common(hull: PublishedHull) -> dict[str, Any]:
    return {
        "t0": format_timestamp(hull.t0),
        "t1": format_timestamp(hull.t1),
        "unit": hull.patch.unit,
        "coverage": hull.coverage(),
    }


def _senml(node: str, hull: PublishedHull) -> Iterator[Publication]:
    """As SenML (RFC 8428): of each channel, or of all of a large skin's patch."""
    lo, hi = hull.bounds
    span = seconds(hull.t1 - hull.t0), SECONDS
    if hull.is_large:
        leaf = f"patches/{hull.patch.patch_id}"
        about = {"coverage": (hull.coverage(len(lo)), RATIO), "span": span}
        if hull.contact is not None:
            about["contact/lo"] = float(hull.contact == "certain"), RATIO
            about["contact/hi"] = float(hull.contact != "impossible"), RATIO
        parts = [(leaf, float(lo.min()), float(hi.max()))]
    else:
        about = {"coverage": (hull.coverage(), RATIO), "span": span}
        sampled = np.flatnonzero(hull.samples).tolist()
        channels = hull.patch.channels
        parts = [(channels[k], float(lo[k]), float(hi[k])) for k in sampled]
    for leaf, low, high in parts:
        pack = Pack(f"{node}/{leaf}/", hull.patch.unit, hull.t0, (0,), (low,), (high,), about)
        yield senml_topic(node, leaf), as_json(pack), False


def statements(node: str, message: Statements, skin: DescribedLayout) -> Iterator[Publication]:
    """Each statement, with the fields of an event of REST. Their ``id``s are numbered."""
    stated = [
        *((peak.time, _peak(peak, skin.patches[peak.patch])) for peak in message.peaks),
        *((contact.time, _contact(contact)) for contact in message.contacts),
        *((verdict.time, _monitor_verdict(verdict)) for verdict in message.verdicts),
        *((gap.time, _gap(gap, skin)) for gap in message.gaps),
    ]
    for number, (time, fields) in enumerate(stated):
        item = _event(node, message.position, time)
        item |= {"id": f"{item['id']}/{number}"} | fields
        yield live_topic(node, "events"), orjson.dumps(item), False


def status(node: str, message: Status, *, online: bool) -> Publication:
    """A node's status, retained."""
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
    }
    if message.faults is not None:
        item["faults"] = [
            {"taxel": fault.taxel}
            | {"dead": fault.dead.name.lower(), "stuck": fault.stuck.name.lower()}
            for fault in message.faults
        ]
    if message.energy is not None:
        item["energy"] = _energy(message.energy)
    return live_topic(node, "status"), orjson.dumps(item), True


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


def _peak(peak: frames.Peak, patch: frames.Patch) -> dict[str, Any]:
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


def _gap(gap: frames.Gap, skin: DescribedLayout) -> dict[str, Any]:
    return {
        "detail": {
            "reason": gap.reason,
            "messages": gap.messages,
            "samples": gap.samples,
            "patches": [skin.patches[number].patch_id for number in gap.patches],
        }
    }


def _interval(bounds: tuple[float, float]) -> dict[str, float]:
    return {"lo": bounds[0], "hi": bounds[1]}
