"""A frame: what one node measured on one page of its skin, in one stretch of time."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import cbor2

from eskin.errors import MessageError, shown
from eskin.wire.frames.content_hash import HASH_BYTES
from eskin.wire.frames.layout import MOST_PAGES, MOST_PATCHES
from eskin.wire.frames.sample_codec import (
    COARSEST,
    FINEST,
    MOST_COLUMNS,
    MOST_OFFSET,
    MOST_ROWS,
    MOST_STRIDE,
    SampleCodes,
    Sampling,
    decode_samples,
    encode_samples,
)
from eskin.wire.messages.cbor_map import (
    MOST_BYTES,
    MOST_COUNT,
    Fields,
    dump,
    integer,
    items,
    load,
    octets,
    real,
    row,
)
from eskin.wire.messages.header import Kind, Position, position_fields, read_position
from eskin.wire.timestamp import MOST_INSTANT

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Sequence

    from eskin.interval import Interval
    from eskin.wire.frames.layout import Layout
    from eskin.wire.frames.patch import Patch

MOST_GRIDS: Final = 16
MOST_CELLS: Final = 2**18
"""Rows times columns of all patches: with strides, few samples may lie in many cells."""
LONGEST_PERIOD: Final = 1_000_000_000_000
_FIELDS: Final = frozenset(range(1, 10))
HEAD_BYTES: Final = 98
GRID_BYTES: Final = 40
PATCH_BYTES: Final = 31
"""The most bytes of what is no sample: once a frame, for each grid, and for each patch."""
_STRIDES, _UNSHARED = 1, 2
_OPTIONS: Final = ([_STRIDES], [_UNSHARED], [_STRIDES, _UNSHARED])
_MAP_OF_9: Final = 0xA9
_HEAD_FIELDS: Final = 8


class Grid(NamedTuple):
    """When patches are sampled, and how surely they enclose the truth.

    Attributes:
        delay: From the frame's first instant to the first row, in ns.
        period: From row to row, in ns.
        first_row: Number of the first row in the node's schedule.
        rows: How many there are.
        coverage: Probability that a sample's interval encloses the truth.
    """

    delay: int
    period: int
    first_row: int
    rows: int
    coverage: float


@dataclass(frozen=True, slots=True)
class PatchSamples:
    """Samples of one patch.

    Attributes:
        patch: Its number in the layout.
        grid: Number of its grid in the frame.
        epoch: Within an epoch shared errors are constant; 0 where samples share none.
        columns: How many channels it has.
        samples: Its samples, encoded.
        strides: For each column ``k``: it is sampled in rows whose number is a multiple of ``2^k``;
            empty where each row has a sample of every column.
        unshared: Columns that have no shared error in this frame, ascending: such as clipped ones.
    """

    patch: int
    grid: int
    epoch: int
    columns: int
    samples: SampleCodes
    strides: bytes = b""
    unshared: tuple[int, ...] = ()

    @classmethod
    def pack(
        cls,
        values: Interval,
        least_width: float,
        *,
        patch: int,
        grid: int,
        first_row: int,
        epoch: int = 0,
        strides: bytes = b"",
        unshared: Sequence[int] = (),
    ) -> Self:
        """Encode the samples of a patch.

        Args:
            values: Shape ``(rows, columns)``; unbounded on both sides where nothing is known.
            least_width: As the patch's description states it.
            patch: Its number in the layout.
            grid: Number of its grid in the frame.
            first_row: As its grid states it.
            epoch: See the class.
            strides: See the class.
            unshared: See the class.

        Raises:
            MessageError: The values are no matrix of intervals that are not empty.
        """
        rows, columns = values.shape
        sampling = Sampling(rows, columns, first_row, strides)
        samples = encode_samples(values, sampling, least_width)
        return cls(patch, grid, epoch, columns, samples, strides, tuple(unshared))

    def sampling(self, grid: Grid) -> Sampling:
        """Which cells of its matrix hold a sample."""
        return Sampling(grid.rows, self.columns, grid.first_row, self.strides)

    def limit(self, grid: Grid) -> int:
        """The most bytes that it takes in a frame, whatever its values are."""
        options = 3 + len(self.strides) if self.strides else 0
        options += 2 + (self.columns + 7) // 8 if self.unshared else 0
        return PATCH_BYTES + bool(options) + options + self.sampling(grid).limit

    def encode(self) -> list[object]:
        """Write as an item of CBOR."""
        exponent, offset, codes = self.samples
        options: dict[int, object] = {}
        if self.strides:
            options[_STRIDES] = self.strides
        if self.unshared:
            bits = sum(1 << column for column in self.unshared)
            options[_UNSHARED] = bits.to_bytes((self.columns + 7) // 8, "little")
        head: list[object] = [self.patch, self.grid, self.epoch, self.columns]
        return [*head, exponent, offset, codes, *([options] if options else [])]

    @classmethod
    def read(cls, value: object) -> Self:
        """Read samples, which stay encoded.

        Raises:
            MessageError: A part has another type, or is out of range.
        """
        found = items(value, "field 9", 8)
        options = _options(found.pop()) if len(found) == 8 else Fields({})
        patch, grid, epoch, columns, exponent, offset, codes = row(found, "field 9", 7)
        size = integer(columns, "columns", 1, MOST_COLUMNS)
        return cls(
            patch=integer(patch, "patch", 0, MOST_PATCHES - 1),
            grid=integer(grid, "grid", 0, MOST_GRIDS - 1),
            epoch=integer(epoch, "epoch", 0, MOST_COUNT),
            columns=size,
            samples=SampleCodes(
                integer(exponent, "exponent", FINEST, COARSEST),
                integer(offset, "offset", -MOST_OFFSET, MOST_OFFSET),
                octets(codes, "codes", 1, MOST_BYTES),
            ),
            strides=options.octets(_STRIDES, size, size) if options.has(_STRIDES) else b"",
            unshared=_columns(options, size) if options.has(_UNSHARED) else (),
        )

    def require_consistent(self, grids: Sequence[Grid]) -> None:
        """Check that its parts fit each other, and a grid of its frame.

        Raises:
            MessageError: They do not.
        """
        if self.grid >= len(grids):
            raise MessageError(f"grid is {self.grid}; there are {len(grids)}")
        if self.strides and (not any(self.strides) or max(self.strides) > MOST_STRIDE):
            raise MessageError(
                f"strides are {self.strides.hex()}; allowed are 0 to {MOST_STRIDE}, not all 0"
            )
        if self.unshared and not self.epoch:
            raise MessageError("columns share no error, and nor does the patch: its epoch is 0")
        if not sum(self.sampling(grids[self.grid]).counts):
            raise MessageError("no row of the patch's grid holds a sample of it")


def frame_limit(columns: Iterable[int], rows: int) -> int:
    """The most bytes of a frame with one grid, whose patches have all their samples.

    A page is planned so that this is at most 64 KiB.

    Args:
        columns: Of each patch.
        rows: Of the grid.
    """
    each = (PATCH_BYTES + Sampling(rows, count).limit for count in columns)
    return HEAD_BYTES + GRID_BYTES + sum(each)


@dataclass(frozen=True, slots=True)
class FrameHead:
    """What stands in a frame before its patches.

    Row ``r`` of a patch was sampled in column ``c`` at an instant within ``time`` plus ``delay +
    r·period`` of its grid plus ``skew[c]`` of its description; its interval holds at that instant.

    Attributes:
        position: Boot and sequence.
        layout: Hash of the layout by which it is read.
        page: Number of its page in the layout.
        ticks: The node's clock at the first instant, ns since its start.
        time: Enclosure of the same instant, UTC ns, for the whole stretch: it contains how far the
            node's clock may drift until its last row.
        grids: When patches were sampled, in the order of their first use.
    """

    position: Position
    layout: bytes
    page: int
    ticks: int
    time: tuple[int, int]
    grids: tuple[Grid, ...]

    @property
    def stretch(self) -> tuple[int, int]:
        """Names the stretch of time within its node: the pages of a picture share it."""
        return self.position.boot, self.ticks


@dataclass(frozen=True, slots=True)
class Frame(FrameHead):
    """Samples of the patches of one page.

    Attributes:
        patches: Samples, with ascending numbers of patches; patches without any are not in it.
        values: Of each patch the decoded samples, shape ``(rows, columns)``.

    Raises:
        MessageError: The parts do not fit each other, or the frame could be too long.
    """

    patches: tuple[PatchSamples, ...]
    values: tuple[Interval, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        used = -1
        for before, each in zip((None, *self.patches), self.patches, strict=False):
            place = f"field 9, patch {each.patch}"
            if before is not None and each.patch <= before.patch:
                raise MessageError(f"{place} follows patch {before.patch}; they must ascend")
            try:
                each.require_consistent(self.grids)
            except MessageError as error:
                raise MessageError(f"{place}: {error}") from error
            if each.grid > used + 1:
                raise MessageError(f"{place} has grid {each.grid} before {used + 1} is used")
            used = max(used, each.grid)
        if used != len(self.grids) - 1 or len(set(self.grids)) < len(self.grids) or used < 0:
            raise MessageError("field 8 has a grid twice, or one that no patch has")
        if self.limit > MOST_BYTES:
            raise MessageError(
                f"frame may take {self.limit} bytes; at most {MOST_BYTES} are allowed: "
                "use more pages or a shorter stretch"
            )
        cells = sum(each.columns * self.grids[each.grid].rows for each in self.patches)
        if cells > MOST_CELLS:
            raise MessageError(
                f"frame has {cells} cells; at most {MOST_CELLS} are allowed: sample columns that "
                "have great strides in patches of their own, with a longer period"
            )
        object.__setattr__(self, "values", tuple(map(self._decode, self.patches)))

    def _decode(self, patch: PatchSamples) -> Interval:
        try:
            return decode_samples(patch.samples, patch.sampling(self.grids[patch.grid]))
        except MessageError as error:
            raise MessageError(f"field 9, patch {patch.patch}: {error}") from error

    @property
    def limit(self) -> int:
        """The most bytes that a frame with this sampling takes, whatever its values are.

        A receiver rejects a frame whose limit is beyond 64 KiB, however few bytes it has: so a page
        that fits does so always, and no frame of few bytes becomes many samples.
        """
        patches = sum(each.limit(self.grids[each.grid]) for each in self.patches)
        return HEAD_BYTES + GRID_BYTES * len(self.grids) + patches

    def require_layout(self, layout: Layout, patches: Sequence[Patch]) -> None:
        """Check that a layout and its patches are those by which this frame is read.

        Raises:
            MessageError: They are not, or the frame does not fit them.
        """
        if layout.content_hash != self.layout:
            raise MessageError(f"the frame is read by layout {self.layout.hex()}, not by this one")
        numbers = layout.page_range(self.page)
        for each in self.patches:
            if each.patch not in numbers:
                raise MessageError(f"patch {each.patch} is not on page {self.page}")
            columns = len(patches[each.patch].taxels)
            if each.columns != columns:
                raise MessageError(f"patch {each.patch} has {each.columns} columns, not {columns}")
            if each.epoch and not patches[each.patch].alpha:
                raise MessageError(f"patch {each.patch} has an epoch, but no shared error")

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump(
            position_fields(Kind.FRAME, self.position)
            | {4: self.layout, 5: self.page, 6: self.ticks, 7: list(self.time)}
            | {8: [list(grid) for grid in self.grids]}
            | {9: [patch.encode() for patch in self.patches]}
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a frame.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a frame from its decoded fields."""
        fields.only(_FIELDS)
        fields.integer(1, Kind.FRAME, Kind.FRAME)
        return cls(
            position=read_position(fields),
            layout=fields.octets(4, HASH_BYTES, HASH_BYTES),
            page=fields.integer(5, 0, MOST_PAGES - 1),
            ticks=fields.integer(6, 0, MOST_INSTANT),
            time=fields.instants(7),
            grids=tuple(_grid(each) for each in fields.items(8, MOST_GRIDS)),
            patches=tuple(PatchSamples.read(each) for each in fields.items(9, MOST_PATCHES)),
        )


def _grid(value: object) -> Grid:
    delay, period, first_row, rows, coverage = row(value, "field 8", 5)
    return Grid(
        delay=integer(delay, "field 8, delay", 0, LONGEST_PERIOD),
        period=integer(period, "field 8, period", 1, LONGEST_PERIOD),
        first_row=integer(first_row, "field 8, first row", 0, MOST_COUNT),
        rows=integer(rows, "field 8, rows", 1, MOST_ROWS),
        coverage=real(coverage, "field 8, coverage", 0.0, 1.0),
    )


def _options(value: object) -> Fields:
    if not isinstance(value, dict) or list(value) not in _OPTIONS or {*map(type, value)} != {int}:
        raise MessageError(f"field 9 has options {shown(value)}; expected a map of some of 1 and 2")
    return Fields(value)


def _columns(options: Fields, columns: int) -> tuple[int, ...]:
    size = (columns + 7) // 8
    bits = int.from_bytes(options.octets(_UNSHARED, size, size), "little")
    if not bits or bits >> columns:
        raise MessageError(f"unshared columns are {bits:#x}; expected some of {columns}")
    return tuple(column for column in range(columns) if bits >> column & 1)


def read_head(data: bytes) -> FrameHead:
    """Read the head of a frame that was checked when it was stored.

    Raises:
        MessageError: It is no frame.
    """
    if data[:3] != bytes((_MAP_OF_9, 1, Kind.FRAME)):
        raise MessageError(f"message begins with {data[:3].hex()}; expected a frame")
    stream = BytesIO(data)
    stream.seek(1)
    decoder = cbor2.CBORDecoder(stream)
    try:
        fields: dict[Any, Any] = {decoder.decode(): decoder.decode() for _ in range(_HEAD_FIELDS)}
        position = Position(fields[2], fields[3])
        grids = tuple(Grid(*grid) for grid in fields[8])
        return FrameHead(position, fields[4], fields[5], fields[6], tuple(fields[7]), grids)
    except (cbor2.CBORError, LookupError, TypeError) as error:
        raise MessageError(f"frame has no head: {error}") from error


def replace_sequence(data: bytes, sequence: int) -> bytes:
    """A frame with another sequence number.

    Args:
        data: A frame that was checked when it was stored.
        sequence: The number, below 2^53.

    Raises:
        MessageError: It is no frame.
    """
    boot, old = read_head(data).position
    before = data[:4] + cbor2.dumps(boot) + b"\x03"
    return before + cbor2.dumps(sequence) + data[len(before) + len(cbor2.dumps(old)) :]


def select_patches(data: bytes, patches: Container[int]) -> bytes | None:
    """A frame with some of its patches, whose records are copied; ``None`` with none of them.

    Grids that no patch is left of are dropped, and the others renumbered, so that the encoding is
    the only one of its content.

    Args:
        data: A frame that was checked when it was stored.
        patches: Numbers in the layout.

    Raises:
        MessageError: It is no frame.
    """
    try:
        fields: dict[Any, Any] = cbor2.loads(data)
        records: list[list[Any]] = fields[9]
        kept = [record for record in records if record[0] in patches]
        used = list(dict.fromkeys(record[1] for record in kept))
        grids = [fields[8][grid] for grid in used]
    except (cbor2.CBORError, LookupError, TypeError) as error:
        raise MessageError(f"frame cannot be read: {error}") from error
    if not kept:
        return None
    if len(kept) == len(records):
        return data
    numbers = {grid: number for number, grid in enumerate(used)}
    for record in kept:
        record[1] = numbers[record[1]]
    return dump({**fields, 8: grids, 9: kept})
