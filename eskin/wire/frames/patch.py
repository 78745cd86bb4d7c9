"""A patch: channels of one quantity, sampled together, and what no command changes of them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import IntEnum
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Final, Self, TypeAlias

from eskin.errors import MessageError
from eskin.wire.biometric import is_biometric
from eskin.wire.frames.content_hash import content_hash
from eskin.wire.frames.sample_codec import MOST_COLUMNS
from eskin.wire.messages.cbor_map import (
    Fields,
    dump,
    integer,
    items,
    load,
    octets,
    pair,
    real,
    text,
)
from eskin.wire.messages.command import TAXEL
from eskin.wire.messages.header import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

FARTHEST: Final = 100_000_000
"""Of a position from the map's origin, in um: 100 m."""
Pairs: TypeAlias = "tuple[tuple[int, int], ...]"
_MOST_PAIRS: Final = 64 * 64
"""All pairs of two patches."""
Bounds: TypeAlias = "tuple[float, float]"
_FIELDS: Final = frozenset(range(1, 17))
_QUANTITY: Final = re.compile(r"[a-z][a-z0-9_]{0,30}")
_NAME_LENGTH: Final = 31
_UNIT_LENGTH: Final = 16
_LONGEST_SKEW: Final = 1_000_000_000_000
WEARER: Final = "wearer"
"""The only subject that a node may name: who wears it, at the time of measurement."""


def write_differences(values: Iterable[int]) -> list[int]:
    """The first value, then how much each differs from the one before."""
    listed = list(values)
    before = [0, *listed[:-1]]
    return [value - last for value, last in zip(listed, before, strict=False)]


def read_differences(
    value: object, what: str, least: int, most: int, *, count: int
) -> tuple[int, ...]:
    """The values of which differences were written.

    Args:
        value: An item that was decoded.
        what: Names its field, for errors.
        least: Least value that is allowed.
        most: Greatest one.
        count: How many there may be.

    Raises:
        MessageError: They are none, too many, or outside of these bounds.
    """
    steps = [integer(each, what, -2 * most, 2 * most) for each in items(value, what, count)]
    values = tuple(accumulate(steps))
    for each in values:
        integer(each, what, least, most)
    return values


def write_pairs(pairs: Iterable[tuple[int, int]]) -> bytes:
    """Two bytes a pair."""
    return b"".join(map(bytes, pairs))


def read_pairs(value: object, what: str) -> Pairs:
    """Read pairs of columns.

    Raises:
        MessageError: It is no byte string of pairs.
    """
    data = octets(value, what, 2, 2 * _MOST_PAIRS)
    if len(data) % 2:
        raise MessageError(f"{what} has {len(data)} bytes; expected two a pair")
    return tuple(zip(data[::2], data[1::2], strict=True))


def require_pairs(pairs: Pairs, columns: tuple[int, int], what: str) -> None:
    """Check that pairs are ascending, none twice, of columns that there are.

    Raises:
        MessageError: They are not.
    """
    if any(second <= first for first, second in pairwise(pairs)):
        raise MessageError(f"{what} names pairs twice, or not in ascending order")
    for one in pairs:
        if not (0 <= one[0] < columns[0] and 0 <= one[1] < columns[1]):
            raise MessageError(f"{what} names columns {one}; there are {columns}")


class Privacy(IntEnum):
    """Whether samples are data about a person."""

    PUBLIC = 0
    BIOMETRIC = 1


@dataclass(frozen=True, slots=True)
class Patch:
    """Up to 64 channels with one quantity, one privacy class and one subject, sampled together.

    Its description is named by `content_hash`; ``patch_id`` stays when the description changes.

    Attributes:
        patch_id: Names it within its node.
        quantity: Of all channels.
        unit: UCUM code of all bounds.
        taxels: Of each column; its channel is ``{taxel}.{quantity}``.
        least_width: Least width of a sample's interval by design, in the unit; sets the quantum.
        privacy: Whether the samples are data about a person.
        subject: `WEARER` if biometric, else ``None``: who that is, the gateway knows.
        positions: x and y, or x, y and z of all columns, in um.
        neighbours: Pairs of columns whose taxels touch, the lesser first.
        skew: How much later than its row each column is sampled, in ns; empty if not at all.
        alpha: Enclosure of the factor in ``x = alpha·(u + beta)``, above 0. Each column has a
            factor of its own, constant within an epoch; the enclosure is one for all columns or
            one for each; empty where samples share no error.
        beta: The same of the summand, in the unit of u.
        slew: Bound of the quantity's rate of change, in units a second; ``None`` if none is known.
        threshold: From which value on there is a contact, in the unit; ``None`` without contacts.
        cell_area: Area of a taxel's cell, in m2; ``None`` without contacts.

    Raises:
        MessageError: The parts do not fit each other.
    """

    patch_id: str
    quantity: str
    unit: str
    taxels: tuple[str, ...]
    least_width: float
    privacy: Privacy = Privacy.PUBLIC
    subject: str | None = None
    positions: tuple[tuple[int, ...], ...] = ()
    neighbours: Pairs = ()
    skew: tuple[int, ...] = ()
    alpha: tuple[Bounds, ...] = ()
    beta: tuple[Bounds, ...] = ()
    slew: float | None = None
    threshold: float | None = None
    cell_area: float | None = None

    def __post_init__(self) -> None:
        _require_name(self.patch_id, "field 2")
        if _QUANTITY.fullmatch(self.quantity) is None:
            raise MessageError(f"field 3 is {self.quantity!r}; expected such as capacitance")
        _require_count(self.taxels, range(1, MOST_COLUMNS + 1), "field 5")
        for taxel in self.taxels:
            _require_name(taxel, "field 5")
        if len(set(self.taxels)) < len(self.taxels):
            raise MessageError("field 5 names a taxel twice")
        columns = len(self.taxels)
        if (self.subject is None) is (self.privacy is Privacy.BIOMETRIC):
            raise MessageError(
                "field 8 names a subject of a public patch, or a biometric patch has none"
            )
        if self.subject not in {None, WEARER}:
            raise MessageError(f"field 8 names a subject that is not {WEARER!r}; name no person")
        if {*map(is_biometric, self.channels)} != {self.privacy is Privacy.BIOMETRIC}:
            raise MessageError(
                f"field 7 is {self.privacy.name.lower()}, and fields 3 and 5 name channels that "
                "are not: give them a patch of their own"
            )
        _require_count(self.positions, (0, 2, 3), "field 9")
        for axis in self.positions:
            _require_count(axis, (columns,), "field 9")
        require_pairs(self.neighbours, (columns, columns), "field 10")
        if any(first >= second for first, second in self.neighbours):
            raise MessageError("field 10 names a pair with the greater column first")
        _require_count(self.skew, (0, columns), "field 11")
        if self.skew and not any(self.skew):
            raise MessageError("field 11 has skews of 0 only; leave it out")
        _require_shared(self.alpha, self.beta, columns)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel of each column."""
        return tuple(f"{taxel}.{self.quantity}" for taxel in self.taxels)

    @property
    def content_hash(self) -> bytes:
        """What names this description."""
        return content_hash(self.encode())

    def encode(self) -> bytes:
        """Write as CBOR."""
        optional: dict[int, object | None] = {
            8: self.subject,
            9: [write_differences(axis) for axis in self.positions],
            10: write_pairs(self.neighbours),
            11: write_differences(self.skew),
            12: [list(each) for each in self.alpha],
            13: [list(each) for each in self.beta],
            14: self.slew,
            15: self.threshold,
            16: self.cell_area,
        }
        stated = {key: value for key, value in optional.items() if value not in (None, [], b"")}
        return dump(
            {1: int(Kind.PATCH), 2: self.patch_id, 3: self.quantity, 4: self.unit}
            | {5: list(self.taxels), 6: self.least_width, 7: int(self.privacy)}
            | stated
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a patch's description.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a patch's description from its decoded fields."""
        fields.only(_FIELDS)
        fields.integer(1, Kind.PATCH, Kind.PATCH)
        return cls(
            patch_id=fields.text(2, _NAME_LENGTH),
            quantity=fields.text(3, _NAME_LENGTH),
            unit=fields.text(4, _UNIT_LENGTH),
            taxels=tuple(
                text(taxel, "field 5", _NAME_LENGTH) for taxel in fields.items(5, MOST_COLUMNS)
            ),
            least_width=_positive(fields, 6),
            privacy=Privacy(fields.integer(7, 0, max(Privacy))),
            subject=fields.text(8, _NAME_LENGTH) if fields.has(8) else None,
            positions=tuple(
                read_differences(axis, "field 9", -FARTHEST, FARTHEST, count=MOST_COLUMNS)
                for axis in fields.optional_items(9, 3)
            ),
            neighbours=read_pairs(fields.raw(10), "field 10") if fields.has(10) else (),
            skew=read_differences(fields.raw(11), "field 11", 0, _LONGEST_SKEW, count=MOST_COLUMNS)
            if fields.has(11)
            else (),
            alpha=tuple(
                _bounds(each, "field 12") for each in fields.optional_items(12, MOST_COLUMNS)
            ),
            beta=tuple(
                _bounds(each, "field 13") for each in fields.optional_items(13, MOST_COLUMNS)
            ),
            slew=_positive(fields, 14) if fields.has(14) else None,
            threshold=_positive(fields, 15) if fields.has(15) else None,
            cell_area=_positive(fields, 16) if fields.has(16) else None,
        )


def _require_name(name: str, what: str) -> None:
    if TAXEL.fullmatch(name) is None:
        raise MessageError(f"{what} is {name!r}; expected a name such as t01")


def _require_count(values: Sequence[object], counts: Sequence[int], what: str) -> None:
    if len(values) not in counts:
        raise MessageError(f"{what} has {len(values)} items; expected {list(counts)[-1]}")


def _require_shared(alpha: Sequence[Bounds], beta: Sequence[Bounds], columns: int) -> None:
    if bool(alpha) is not bool(beta):
        raise MessageError("fields 12 and 13 stand together, or neither does")
    for what, bounds in (("field 12", alpha), ("field 13", beta)):
        _require_count(bounds, (0, 1, columns), what)
        if len(bounds) > 1 and len(set(bounds)) == 1:
            raise MessageError(f"{what} has the same item for all columns; write it once")
    if any(lo <= 0.0 for lo, _ in alpha):
        raise MessageError("field 12 is not above 0: nothing can be calculated back from it")


def _bounds(value: object, what: str) -> Bounds:
    lo, hi = (_require_finite(real(each, what), what) for each in pair(value, what))
    if lo > hi:
        raise MessageError(f"{what} is reversed: {lo!r} > {hi!r}")
    return lo, hi


def _positive(fields: Fields, key: int) -> float:
    value = _require_finite(fields.real(key), f"field {key}")
    if value <= 0.0:
        raise MessageError(f"field {key} is {value!r}; expected a number above 0")
    return value


def _require_finite(value: float, what: str) -> float:
    if math.isinf(value):
        raise MessageError(f"{what} is {value!r}; expected a finite number")
    return value
