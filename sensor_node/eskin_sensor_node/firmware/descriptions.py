"""Describes patches and layouts as bytes, for `eskin.wire.frames` to read."""

from eskin_sensor_node.firmware.cbor import Writer
from eskin_sensor_node.firmware.message_writer import LAYOUT, PATCH

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from eskin.wire.frames import Layout, Patch


def describe_patch(patch: "Patch") -> bytes:
    """The description of a patch; it is named by its SHA-256."""
    fields: dict[int, Any] = {
        1: PATCH,
        2: patch.patch_id,
        3: patch.quantity,
        4: patch.unit,
        5: patch.taxels,
        6: patch.least_width,
        7: patch.privacy,
    }
    optional = (
        (8, patch.subject),
        (9, [_differences(axis) for axis in patch.positions]),
        (10, _pairs(patch.neighbours)),
        (11, _differences(patch.skew)),
        (12, patch.alpha),
        (13, patch.beta),
        (14, patch.slew),
        (15, patch.threshold),
        (16, patch.cell_area),
    )
    fields.update({key: value for key, value in optional if value})
    return _written(fields)


def describe_layout(layout: "Layout") -> bytes:
    """The description of a layout; it is named by its SHA-256."""
    fields: dict[int, Any] = {1: LAYOUT, 2: b"".join(layout.patches), 3: layout.pages}
    if layout.seams:
        fields[4] = [(first, second, _pairs(pairs)) for first, second, pairs in layout.seams]
    if layout.controllers:
        fields[5] = layout.controllers
    if layout.outline:
        fields[6] = [(_differences(x), _differences(y)) for x, y in layout.outline]
    return _written(fields)


def _written(fields: "dict[int, Any]") -> bytes:
    out = Writer()
    out.item(fields)
    return bytes(out.buffer)


def _differences(values: "Sequence[int]") -> "list[int]":
    """The first value, then how much each differs from the one before."""
    found = []
    before = 0
    for value in values:
        found.append(value - before)
        before = value
    return found


def _pairs(pairs: "Sequence[tuple[int, int]]") -> bytes:
    """Two bytes a pair of columns."""
    return bytes([column for pair in pairs for column in pair])
