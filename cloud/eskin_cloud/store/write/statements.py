"""Rows of events that statements give: one for each peak, contact, verdict and gap."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

import orjson

from eskin.errors import MessageError
from eskin.wire.frames import Because
from eskin_cloud.store.write.events import event_row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.wire.frames import Contact, Gap, MonitorVerdict, Peak, Statements
    from eskin_cloud.store.descriptions import DescribedLayout
    from eskin_cloud.store.write.write_cache import Row


def require_patches(statements: Statements, described: DescribedLayout) -> None:
    """Check that statements name patches and columns of their layout.

    Raises:
        MessageError: They do not.
    """
    most = len(described.patches)
    for peak in statements.peaks:
        if peak.patch >= most or peak.column >= len(described.patches[peak.patch].taxels):
            raise MessageError(
                f"field 5 names column {peak.column} of patch {peak.patch}, which the layout lacks"
            )
    for gap in statements.gaps:
        if gap.patches and gap.patches[-1] >= most:
            raise MessageError(f"field 8 names patch {gap.patches[-1]}; the layout has {most}")


def statement_rows(
    node: str, statements: Statements, described: DescribedLayout, data: bytes
) -> Iterator[Row]:
    """The rows, without cursors; the first holds the message.

    Args:
        node: The node.
        statements: What it stated.
        described: The layout by which it is read.
        data: The message's bytes.
    """
    rows = chain(
        (_peak_row(node, statements, each, described) for each in statements.peaks),
        (_contact_row(node, statements, each) for each in statements.contacts),
        (_verdict_row(node, statements, each) for each in statements.verdicts),
        (_gap_row(node, statements, each, described) for each in statements.gaps),
    )
    for number, row in enumerate(rows):
        yield row if number else row | {"data": data}


def _peak_row(node: str, said: Statements, peak: Peak, described: DescribedLayout) -> Row:
    patch = described.patches[peak.patch]
    return event_row(
        node,
        "peak",
        said.position,
        peak.time,
        channel=patch.channels[peak.column],
        verdict=peak.verdict.name.lower(),
        count_lo=peak.counts[0],
        count_hi=peak.counts[1],
        height_lo=peak.height[0],
        height_hi=peak.height[1],
        prominence_lo=peak.prominence[0],
        prominence_hi=peak.prominence[1],
        unit=patch.unit,
        coverage=peak.coverage,
    )


def _contact_row(node: str, said: Statements, contact: Contact) -> Row:
    links = [{"contact": each.contact, "verdict": each.verdict.name.lower()}
             for each in contact.links]  # fmt: skip
    detail = {
        "label": contact.label,
        "cells": contact.cells,
        "force": contact.force,
        "centroid": contact.centroid,
        "links": links,
    }
    return event_row(
        node,
        "contact",
        said.position,
        contact.time,
        verdict=contact.verdict.name.lower(),
        count_lo=contact.counts[0],
        count_hi=contact.counts[1],
        coverage=contact.coverage,
        detail=orjson.dumps(detail).decode(),
    )


def _verdict_row(node: str, said: Statements, verdict: MonitorVerdict) -> Row:
    because = [each.name.lower() for each in Because if each in verdict.because and each.name]
    detail = {"monitor": verdict.monitor, "final": verdict.final, "because": because}
    return event_row(
        node,
        "verdict",
        said.position,
        verdict.time,
        verdict=verdict.verdict.name.lower(),
        coverage=verdict.coverage,
        detail=orjson.dumps(detail).decode(),
    )


def _gap_row(node: str, said: Statements, gap: Gap, described: DescribedLayout) -> Row:
    counts = ((gap.messages, "message"), (gap.samples, "sample"))
    lost = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
    detail = f"{gap.reason}: {' and '.join(lost)} lost" if lost else gap.reason
    if gap.patches:
        names = ", ".join(described.patches[patch].patch_id for patch in gap.patches)
        detail += f"; patches {names}"
    return event_row(node, "gap", said.position, gap.time, detail=detail)
