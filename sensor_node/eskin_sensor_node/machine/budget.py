"""What a node's firmware needs of its microcontroller's RAM and flash.

Objects in RAM are counted as MicroPython lays them out on 32 bits (blocks of 16 bytes, a float of
64 bits in each); the tests compare with its heap.

The numbers that an expression leaves behind are not counted: they are garbage, which the heap
collects whenever it needs the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError
from eskin.wire.frames import frame_limit
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin_sensor_node.firmware.autoranging import MOST
from eskin_sensor_node.firmware.taxel.pad import SLOTS
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.machine.processor import greatest_frames
from eskin_sensor_node.machine.schedule import build_schedule

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.settings import NodeSettings

FIRMWARE: Final = 77_538
"""Bytes of all modules of the firmware, compiled by mpy-cross 1.27 as they stand."""
INTERPRETER: Final = 256 * 1024
"""Bytes kept for MicroPython, which "fits and runs within just 256k of code space"."""
PROGRAM: Final = 136 * 1024
"""Bytes kept for the firmware's modules, as MicroPython loads them."""
CONNECTION: Final = 48 * 1024
"""Bytes kept for TLS: two records of 16 KiB and what a handshake needs."""
_TAXEL: Final = 1536
"""Bytes of a taxel's calibration, schedule and control unit."""
_RANGES: Final = 2 * MOST * 48
"""Bytes of the ranges beyond both ends of a frame's own: gain and step of each."""
_CHANNEL: Final = 768
"""Bytes of a channel's unit, rest and filter."""
_DETECTOR: Final = 10 * 160
"""Bytes of a detector's stretches: two that grow and eight that wait."""
_PART: Final = 320
"""Bytes of what a channel has of a stretch, besides its bounds."""
_ASSEMBLER: Final = 2048
"""Bytes of what collects a stretch: its patches, and the matrices of the latest frames."""
_CELL: Final = 48
"""Bytes of a sample while its matrix is encoded: its bounds, its place, its codes."""
_PEAK: Final = 384
"""Bytes of a peak until it is written."""
_PEAKS: Final = 16
"""Peaks of one frame that wait to be stored, of each channel."""
_FLIGHT: Final = 32
"""Bytes of an entry in the index of messages under way."""
_BOUND: Final = 8
_CODE: Final = 2
_RANGE: Final = 1
_MEMORY: Final = SLOTS * (4 + 2 * _BOUND) + 3 * 16
"""Bytes in which a pad remembers what a sensor's codes mean: code, bounds, three arrays' heads."""
_COLUMN: Final = 4 * 2 + 7 * _BOUND + 2 * 2
"""Bytes of a skin's taxel: its neighbours, its window of the self-test, its place and verdict."""
_DESCRIBED: Final = 24
"""Bytes of a taxel in the description of its patch, at most."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Bytes of RAM by purpose.

    Attributes:
        program: The firmware's modules.
        connection: TLS.
        codes: Two buffers of codes for each input: one fills while the other is worked off; and of
            the ranges that an amplified input's samples were converted with.
        bounds: A lower and an upper bound of each sample of a frame, for each channel.
        waiting: Bounds that wait until the stretch is complete.
        objects: Calibrations, schedules, rests, filters, detectors.
        messages: A stretch's messages while they are written, and the one that is being sealed.
        window: The index of messages under way.
    """

    program: int
    connection: int
    codes: int
    bounds: int
    waiting: int
    objects: int
    messages: int
    window: int

    @property
    def total(self) -> int:
        """All of it."""
        return sum(self.parts().values())

    def parts(self) -> dict[str, int]:
        """Bytes by purpose."""
        return {name: getattr(self, name) for name in self.__slots__}


def ram_budget(settings: NodeSettings) -> Budget:
    """What a node needs."""
    if settings.skin.present:
        return _skin_budget(settings)
    layout = plan_layout(settings)
    schedules = [
        build_schedule(taxel, settings.sampling, most)
        for taxel, most in zip(settings.taxel, layout.most, strict=True)
    ]
    each = list(zip(schedules, settings.taxel, strict=True))
    codes = [
        2 * schedule.capacity * (_CODE * _inputs(taxel) + _RANGE * taxel.firmware.amplified)
        for schedule, taxel in each
    ]
    bounds = [2 * _BOUND * schedule.capacity * len(taxel.units) for schedule, taxel in each]
    rows: dict[int, list[int]] = {}
    for schedule, columns in zip(schedules, layout.columns, strict=True):
        for patch, _ in columns:
            rows.setdefault(patch.number, []).append(schedule.capacity)
    cells = [max(found) * len(found) for found in rows.values()]
    frames = [frame_limit([len(found)], max(found)) for found in rows.values()]
    peaks = sum(len(taxel.prominences) for taxel in settings.taxel)
    return Budget(
        program=PROGRAM,
        connection=CONNECTION,
        codes=sum(codes),
        bounds=sum(bounds),
        waiting=sum(bounds) + _PART * sum(len(taxel.units) for taxel in settings.taxel),
        objects=_ASSEMBLER + sum(map(taxel_objects, settings.taxel)),
        # All frames of a stretch, one more while it is sealed, a matrix while it is encoded.
        messages=sum(frames)
        + 2 * min(sum(frames), MOST_BYTES)
        + max(cells) * _CELL
        + peaks * _PEAKS * _PEAK,
        window=_FLIGHT * settings.broker.window,
    )


def _skin_budget(settings: NodeSettings) -> Budget:
    """Of a skin: all samples of a stretch are measured at once, and its frames are written."""
    skin = settings.skin
    taxels, samples = skin.taxels, skin.taxels * skin.rows
    inputs, quantities = 1 + len(skin.air), len(skin.taxel.units)
    frames = sum(greatest_frames(taxels, skin.rows))
    return Budget(
        program=PROGRAM,
        connection=CONNECTION,
        codes=2 * samples * _CODE * inputs,
        bounds=2 * _BOUND * samples * quantities,
        waiting=0,
        objects=_TAXEL + _MEMORY * len(skin.air) + taxels * _COLUMN,
        # One frame more while it is sealed, and the layout, which waits for who asks for it.
        messages=frames + 2 * MOST_BYTES + taxels * _DESCRIBED,
        window=_FLIGHT * settings.broker.window,
    )


def taxel_objects(taxel: TaxelSection) -> int:
    """Bytes of a taxel's objects besides its buffers."""
    peaks = sum(taxel.prominence(quantity) is not None for quantity in taxel.units)
    along = len(taxel.companions)
    of_taxels = _TAXEL * (1 + along) + _MEMORY * along
    return of_taxels + _RANGES + _CHANNEL * len(taxel.units) + _DETECTOR * peaks


def _inputs(taxel: TaxelSection) -> int:
    """Of the converter; those that a taxel reads along besides its own."""
    return max(1, len(taxel.firmware.inputs)) + len(taxel.companions)


def require_ram(settings: NodeSettings) -> None:
    """Check that the machine's RAM holds the node.

    Raises:
        SettingsError: It needs more RAM than there is.
    """
    budget, limit = ram_budget(settings), settings.machine.ram_bytes
    if budget.total <= limit:
        return
    parts = ", ".join(f"{name} {size}" for name, size in budget.parts().items())
    if settings.skin.present:
        raise SettingsError(
            "machine.ram_bytes",
            f"{limit} bytes do not hold this skin, which needs {budget.total} ({parts}); share its "
            f"{settings.skin.taxels} taxels among skin.controllers, use a shorter skin.stretch_ms "
            f"than {settings.skin.stretch_ms:g}, or a machine with more RAM",
        )
    raise SettingsError(
        "machine.ram_bytes",
        f"{limit} bytes do not hold this node, which needs {budget.total} ({parts}); use a shorter "
        f"sampling.stretch_ms than {settings.sampling.stretch_ms:g}, fewer of its "
        f"{len(settings.taxel)} taxels, or a machine with more RAM",
    )


def require_flash(settings: NodeSettings) -> None:
    """Check that the machine's flash holds the program.

    Raises:
        SettingsError: It has less flash.
    """
    limit, need = settings.machine.flash_bytes, FIRMWARE + INTERPRETER
    if need > limit:
        raise SettingsError(
            "machine.flash_bytes",
            f"{limit} bytes do not hold the program, which needs {need} (firmware {FIRMWARE}, "
            f"interpreter {INTERPRETER}); use a machine with more flash",
        )
