"""Pictures of a skin as JSON, Arrow (IPC stream) and CBOR sequence."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa

from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, PatchSamples, Sampling
from eskin.wire.frames.frame import LONGEST_PERIOD
from eskin.wire.frames.sample_codec import MOST_ROWS
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.frames import describe_pictures

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from eskin_cloud.query.pictures import Pictures

_HEAD_BYTES: Final = 200
_PATCH_BYTES: Final = 40
"""At least what a frame takes without codes, and a patch in it."""


def as_json(pictures: Pictures) -> bytes:
    """JSON; an unbounded side is null, and both are where nothing is known."""
    return dump(describe_pictures(pictures))


def as_arrow(pictures: Pictures) -> bytes:
    """Arrow's IPC stream: ``time`` (timestamp, ns, UTC), ``lo``, ``hi``, ``contact``.

    The last three are lists with a value for each taxel; an unbounded side is infinite. What else
    is stated stands in the schema's metadata; ``taxels`` there is a JSON array.
    """
    size = len(pictures.taxels)
    metadata = {
        "node": pictures.node,
        "layout": pictures.described.hash.hex(),
        "quantity": pictures.quantity,
        "unit": pictures.unit,
        "coverage": repr(pictures.coverage),
        "dt": str(pictures.buckets.width),
        "time_error": str(pictures.time_error),
        "taxels": json.dumps(pictures.taxels),
    }
    time = pa.array(pictures.t + pictures.buckets.start, pa.int64())
    columns = {
        "time": time.cast(pa.timestamp("ns", tz="UTC")),
        "lo": _lists(pictures.lo, size),
        "hi": _lists(pictures.hi, size),
    }
    if pictures.contact is not None:
        columns["contact"] = _lists(pictures.contact, size)
    table = pa.table(columns).replace_schema_metadata(metadata)
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue()


def as_frames(pictures: Pictures) -> bytes:
    """Frame messages one after the other (RFC 8742), a row for each picture.

    They are those of the layout's pages. A bound lies at most a quantum farther out, as in all
    frames; boot and ticks are 0, and sequence counts the messages of the answer.
    """
    frames: list[bytes] = []
    for page in range(len(pictures.described.layout.pages)):
        numbers = pictures.described.layout.page_range(page)
        mine = [number for number in pictures.patches if number in numbers]
        for begin, end in _rows(pictures, mine) if mine else ():
            frame = _frame(pictures, page, mine, range(begin, end), len(frames))
            frames.append(frame.encode())
    return b"".join(frames)


def _lists(values: Any, size: int) -> Any:
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), size)


def _rows(pictures: Pictures, numbers: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Ranges of pictures that fit a frame of some patches, whatever their values are."""
    sizes = [len(pictures.described.patches[number].taxels) for number in numbers]
    rows = 1 if pictures.buckets.width > LONGEST_PERIOD else min(MOST_ROWS, MOST_BYTES)
    while (
        rows > 1
        and _HEAD_BYTES + sum(_PATCH_BYTES + Sampling(rows, size).limit for size in sizes)
        > MOST_BYTES
    ):
        rows -= max(1, rows // 16)
    for begin in range(0, pictures.buckets.count, rows):
        yield begin, min(begin + rows, pictures.buckets.count)


def _frame(
    pictures: Pictures, page: int, numbers: Sequence[int], rows: range, sequence: int
) -> Frame:
    width, error = pictures.buckets.width, pictures.time_error
    first = pictures.buckets.start + rows.start * width
    grid = Grid(0, min(width, LONGEST_PERIOD), rows.start, len(rows), pictures.coverage)
    sizes = [len(pictures.described.patches[number].taxels) for number in pictures.patches]
    ends = dict(zip(pictures.patches, np.cumsum(sizes).tolist(), strict=True))
    samples = []
    for number in numbers:
        patch = pictures.described.patches[number]
        cells = slice(rows.start, rows.stop), slice(ends[number] - len(patch.taxels), ends[number])
        values = Interval(pictures.lo[cells], pictures.hi[cells])
        packed = PatchSamples.pack(
            values, patch.least_width, patch=number, grid=0, first_row=rows.start
        )
        samples.append(packed)
    time = first - error, first + error
    name = pictures.described.hash
    return Frame(Position(0, sequence), name, page, 0, time, (grid,), tuple(samples))


WRITERS: Final[Mapping[str, Callable[[Pictures], bytes]]] = {
    "application/json": as_json,
    "application/vnd.apache.arrow.stream": as_arrow,
    "application/cbor-seq": as_frames,
}
"""How each media type is written, in our order of preference."""
