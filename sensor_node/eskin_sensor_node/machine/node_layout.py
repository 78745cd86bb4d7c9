"""The layout of a node with ``[[taxel]]`` tables: which channels are columns of which patch."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.privacy import is_biometric
from eskin.wire.frames import Layout, Patch, Privacy, content_hash, frame_limit
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin_sensor_node.firmware.assembler import MOST_GRIDS
from eskin_sensor_node.firmware.assembler import Patch as PlannedPatch
from eskin_sensor_node.firmware.descriptions import describe_layout, describe_patch
from eskin_sensor_node.firmware.sample_codec import finest_exponent
from eskin_sensor_node.firmware.schedule import MOST_ROWS
from eskin_sensor_node.kinds.neighbours import touching
from eskin_sensor_node.kinds.skin_map import skin_map, staged_skins
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.schedule import build_schedule
from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.settings import NodeSettings

MOST_COLUMNS: Final = 64
WEARER: Final = "wearer"
"""The subject of biometric patches; the gateway maps it to a pseudonym."""
FIRST_EPOCH: Final = 1
"""Of errors that no command, autoranging or actuation changes: those of the oscillators' parts."""
_MICRO: Final = 1e6
_NAME: Final = 31
"""Characters of a patch's name, at most."""
_CODES: Final = 4096
"""Readings of the converter at which widths of intervals are looked for."""
_NARROWER: Final = 0.1
"""Share of these readings that may be narrower than the width that a patch states."""


class Column(NamedTuple):
    """Where a channel's samples stand.

    Attributes:
        patch: What the firmware knows of its patch.
        column: Its column there.
    """

    patch: PlannedPatch
    column: int


@dataclass(frozen=True, slots=True)
class NodeLayout:
    """How a node's channels are described.

    Attributes:
        layout: By which its frames are read.
        patches: The descriptions that the layout names, in its order.
        columns: Of each taxel, of each of its quantities, where its samples stand.
        most: Of each taxel, how many samples of a channel a frame holds at most.
    """

    layout: Layout
    patches: tuple[Patch, ...]
    columns: tuple[tuple[Column, ...], ...]
    most: tuple[int, ...]

    @property
    def described(self) -> Described:
        """What a node says of it, as its firmware writes it."""
        return describe(self.layout, self.patches)


class Described(NamedTuple):
    """Descriptions as bytes.

    Attributes:
        layout: Hash of the layout.
        messages: The layout and its patches, by their hashes.
    """

    layout: bytes
    messages: dict[bytes, bytes]


def describe(layout: Layout, patches: Sequence[Patch]) -> Described:
    """What a node says of its frames, as its firmware writes it."""
    messages = [describe_layout(layout), *map(describe_patch, patches)]
    hashes = [content_hash(each) for each in messages]
    return Described(hashes[0], dict(zip(hashes, messages, strict=True)))


class _Kind(NamedTuple):
    """What channels of a patch have in common."""

    kind: str
    quantity: str
    unit: str
    biometric: bool
    sampling: float
    burst: tuple[float, float] | None
    contact: tuple[str, float] | None


def plan_layout(settings: NodeSettings) -> NodeLayout:
    """Describe a node's channels.

    Channels of one kind, quantity and rate share patches, in the order of the settings. The
    patches of a page fit one frame, whatever is measured; biometric ones have pages of their own.
    """
    groups: dict[_Kind, list[int]] = {}
    for number, taxel in enumerate(settings.taxel):
        for quantity, unit in taxel.units.items():
            biometric = is_biometric(f"{taxel.id}.{quantity}")
            found = taxel.contact_of(quantity)
            contact = None if found is None else (found.scenario, found.threshold)
            key = _Kind(taxel.kind, quantity, unit, biometric, taxel.sampling, taxel.burst, contact)
            groups.setdefault(key, []).append(number)
    ordered = sorted(groups.items(), key=lambda group: group[0].biometric)
    parts = [
        (key, numbers[begin : begin + MOST_COLUMNS])
        for key, numbers in ordered
        for begin in range(0, len(numbers), MOST_COLUMNS)
    ]
    most = [MOST_ROWS] * len(settings.taxel)
    for _, numbers in parts:
        rows = _most_rows(len(numbers))
        for number in numbers:
            most[number] = min(most[number], rows)
    patches = _describe(settings, parts)
    capacities = [
        min(build_schedule(settings.taxel[k], settings.sampling, most[k]).capacity for k in numbers)
        for _, numbers in parts
    ]
    pages = _pages(
        [(len(n), rows, key.biometric) for (key, n), rows in zip(parts, capacities, strict=True)]
    )
    layout = Layout(
        tuple(patch.content_hash for patch in patches),
        tuple(map(len, pages)),
        outline=tuple(skin.closed_line for skin in staged_skins(settings.taxel)),
    )
    page_of = {number: page for page, members in enumerate(pages) for number in members}
    places: dict[tuple[int, str], Column] = {}
    for number, ((key, taxels), patch) in enumerate(zip(parts, patches, strict=True)):
        finest = finest_exponent(patch.least_width)
        planned = PlannedPatch(
            number,
            page_of[number],
            len(taxels),
            finest,
            patch.subject or "",
            FIRST_EPOCH if patch.alpha else 0,
        )
        for column, place in enumerate(taxels):
            places[place, key.quantity] = Column(planned, column)
    columns = tuple(
        tuple(places[number, quantity] for quantity in taxel.units)
        for number, taxel in enumerate(settings.taxel)
    )
    return NodeLayout(layout, patches, columns, tuple(most))


def _most_rows(columns: int) -> int:
    """Rows of a patch that fit one frame, whatever their values are."""
    rows = MOST_ROWS
    while frame_limit([columns], rows) > MOST_BYTES:
        rows -= 1
    return rows


def _pages(patches: Sequence[tuple[int, int, bool]]) -> list[list[int]]:
    """Put patches on pages, one after the other.

    Args:
        patches: Columns and rows of each, and whether it is biometric.
    """
    pages: list[list[int]] = []
    used, before = 0, False
    for number, (columns, rows, biometric) in enumerate(patches):
        # A grid for each, as if no two were sampled alike.
        size = frame_limit([columns], rows)
        new = not pages or biometric is not before or len(pages[-1]) == MOST_GRIDS
        if new or used + size > MOST_BYTES:
            pages.append([])
            used = 0
        pages[-1].append(number)
        used, before = used + size, biometric
    return pages


def _describe(
    settings: NodeSettings, parts: Sequence[tuple[_Kind, list[int]]]
) -> tuple[Patch, ...]:
    places = {name: (x, y) for name, x, y in skin_map(settings.taxel)}
    names = [f"{key.kind}-{key.quantity}"[:_NAME] for key, _ in parts]
    patches = []
    for place, (key, numbers) in enumerate(parts):
        taxels = [settings.taxel[k] for k in numbers]
        name, twin = names[place], names[:place].count(names[place])
        positions: tuple[tuple[int, ...], ...] = ()
        if all(taxel.id in places for taxel in taxels):
            each = [[round(_MICRO * v) for v in places[taxel.id]] for taxel in taxels]
            positions = tuple(zip(*each, strict=True))
        widths = [least_widths(taxel, settings.companions(taxel))[key.quantity] for taxel in taxels]
        alpha = tuple(
            shared_errors(taxel, settings.companions(taxel)).get(key.quantity) for taxel in taxels
        )
        shared = tuple(each for each in alpha if each is not None)
        if len(shared) < len(alpha):
            shared = ()
        elif len(set(shared)) == 1:
            shared = shared[:1]
        neighbours: tuple[tuple[int, int], ...] = ()
        threshold, cell_area = None, None
        if key.contact is not None:
            scenario, threshold = key.contact
            cell_area = read_scenario(scenario).skin.build().cell_area
            found = [taxel.contact_of(key.quantity) for taxel in taxels]
            neighbours = touching(scenario, [each.place for each in found if each is not None])
        patches.append(
            Patch(
                patch_id=_numbered(name, twin + 1) if twin else name,
                quantity=key.quantity,
                unit=key.unit,
                taxels=tuple(taxel.id for taxel in taxels),
                least_width=min(widths),
                privacy=Privacy.BIOMETRIC if key.biometric else Privacy.PUBLIC,
                subject=WEARER if key.biometric else None,
                positions=positions,
                neighbours=neighbours,
                alpha=shared,
                beta=((0.0, 0.0),) if shared else (),
                threshold=threshold,
                cell_area=cell_area,
            )
        )
    return tuple(patches)


def _numbered(name: str, number: int) -> str:
    """A name with a number, as long as allowed."""
    end = f"-{number}"
    return name[: _NAME - len(end)] + end


def least_widths(taxel: TaxelSection, companions: Mapping[str, Companion]) -> dict[str, float]:
    """Width of each quantity's intervals that nine of ten readings of the converter have at least.

    Next to the end of a quantity's range intervals become as narrow as one likes, because they are
    cut there; the quantum need not follow. Sensors that are read along are in their middle.
    """
    sheet = data_sheet(taxel, companions)
    bits = [taxel.adc_bits, *(each.taxel.adc_bits for each in companions.values())]
    firmware: Any = taxel.firmware
    widths = _least_widths(firmware, tuple(sorted(sheet.items())), tuple(bits))
    return dict(zip(taxel.units, widths, strict=True))


def shared_errors(
    taxel: TaxelSection, companions: Mapping[str, Companion]
) -> Mapping[str, tuple[float, float]]:
    """Bounds of α, by the quantities whose samples share it."""
    sheet = data_sheet(taxel, companions)
    firmware: Any = taxel.firmware
    return _shared_errors(firmware, tuple(sorted(sheet.items())))


@functools.cache
def _shared_errors(
    firmware: Any, sheet: tuple[tuple[str, float], ...]
) -> Mapping[str, tuple[float, float]]:
    found: Mapping[str, tuple[float, float]] = firmware(dict(sheet), compiled_inversion()).shared()
    return found


@functools.cache
def _least_widths(
    firmware: Any, sheet: tuple[tuple[str, float], ...], bits: tuple[int, ...]
) -> tuple[float, ...]:
    values = dict(sheet)
    calibrated = firmware(values, compiled_inversion())
    if values.get("adaptive"):
        calibrated.adjust(values["gain_most"], 0)
    random = np.random.default_rng(0)
    own = len(calibrated.inputs) - (len(bits) - 1)
    depths = [bits[0]] * own + list(bits[1:])
    shares = [np.linspace(0.0, 1.0, _CODES), *(random.random(_CODES) for _ in range(own - 1))]
    shares += [np.full(_CODES, 0.5) for _ in bits[1:]]
    codes = [
        (share * ((1 << depth) - 1)).astype(np.int64)
        for share, depth in zip(shares, depths, strict=True)
    ]
    bounds = [np.empty(_CODES) for _ in range(2 * len(calibrated.quantities))]
    calibrated.measure(codes, _CODES, bounds)
    calibrated.separate(_CODES, bounds, ())
    found = []
    for lows, highs in zip(bounds[::2], bounds[1::2], strict=True):
        span = highs - lows
        widths = span[np.isfinite(span) & (span > 0.0)]
        found.append(float(np.quantile(widths, _NARROWER)) if widths.size else 1.0)
    return tuple(found)
