"""What a node's firmware needs of its processor: cycles a second, by the prices of what it does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.machine.prices import BILLION, PRICES, inversion, message, passes, stretch
from eskin_sensor_node.machine.schedule import build_schedule

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.settings import NodeSettings

_HEAD: Final = 192
"""Bytes of a frame besides its samples, at most."""
_SAMPLE: Final = 7
"""Bytes of a sample in a frame at most: two codes of three bytes, and a share of the rest."""


@dataclass(frozen=True, slots=True)
class Load:
    """Cycles a second by purpose, at most, in mode ``samples``.

    Attributes:
        inversion: From codes to quantities, with neighbours and the air.
        channels: Rests and peaks.
        messages: Written, encoded, enciphered, kept and sent.
        frames: Interrupts, schedules, states.
    """

    inversion: int
    channels: int
    messages: int
    frames: int

    @property
    def total(self) -> int:
        """All of it."""
        return sum(self.parts().values())

    def parts(self) -> dict[str, int]:
        """Cycles a second by purpose."""
        return {name: getattr(self, name) for name in self.__slots__}


def processor_load(settings: NodeSettings, around: Mapping[int, int]) -> Load:
    """What a node needs.

    Args:
        settings: The node's.
        around: Of each pad, by its number, how many of its neighbours the node measures.
    """
    if settings.skin.present:
        return _skin_load(settings)
    each = [
        _taxel_load(settings, taxel, around.get(number, 0))
        for number, taxel in enumerate(settings.taxel)
    ]
    # A frame a page and stretch; the samples are counted above.
    pages = len(plan_layout(settings).layout.pages)
    frames = pages * message(_HEAD, 1).most * BILLION / settings.sampling.stretch
    inverted, channels, messages, handled = (sum(part) for part in zip(*each, strict=True))
    return Load(round(inverted), round(channels), round(messages + frames), round(handled))


def _taxel_load(
    settings: NodeSettings, taxel: TaxelSection, neighbours: int
) -> tuple[float, float, float, float]:
    frame, rate = _sampled(settings, taxel)
    new = dict.fromkeys(taxel.companions, 0)
    sample: float = inversion(taxel.chain, 1, neighbours, new).most
    sample += sum(PRICES[f"new_{role}"].most / KINDS[role].samples_per_code for role in new)
    sought = [taxel.prominence(quantity) is not None for quantity in taxel.units]
    channels = sum(passes(rest=True, peaks=each).most for each in sought)
    written = (message(_SAMPLE, 1).most - message(0, 1).most + PRICES["encode_frame"].most) * len(
        sought
    )
    depth = settings.machine.dma_samples or frame
    handled = PRICES["frame"].most / frame + PRICES["interrupt"].most / min(depth, frame)
    return rate * sample, rate * channels, rate * written, rate * handled


def _skin_load(settings: NodeSettings) -> Load:
    """Of a skin, whose frames are as long as they may become."""
    section, machine = settings.skin, settings.machine
    taxels = section.taxels
    found = stretch(
        machine.processor,
        section.taxel.chain,
        taxels=taxels,
        rows=section.rows,
        neighbours=section.skin.neighbours.shape[1],
        along=[each.chain for each in section.air.values()],
        sizes=greatest_frames(taxels, section.rows),
    )
    return Load(*(round(each.most * BILLION / section.stretch) for each in found))


def greatest_frames(taxels: int, rows: int) -> list[int]:
    """Bytes of the frames of a stretch, at most."""
    whole, rest = divmod(_SAMPLE * taxels * rows, MOST_BYTES)
    return [MOST_BYTES] * whole + [rest]


def _sampled(settings: NodeSettings, taxel: TaxelSection) -> tuple[int, float]:
    """Samples of a frame at least, and of a second; over its pauses, where it has some."""
    schedule = build_schedule(taxel, settings.sampling)
    if schedule.burst == 0:
        return schedule.capacity, BILLION / schedule.dt
    return min(schedule.capacity, schedule.burst), schedule.burst * BILLION / schedule.pause


def capacity(settings: NodeSettings) -> int:
    """Cycles a second that a node has; only a skin uses more than one core."""
    machine = settings.machine
    return machine.clock_hz * (machine.cores if settings.skin.present else 1)


def require_speed(settings: NodeSettings, around: Mapping[int, int]) -> None:
    """Check that the processor can keep up with the node.

    Raises:
        SettingsError: It needs more cycles a second than there are.
    """
    machine = settings.machine
    load, clock = processor_load(settings, around), machine.clock_hz
    if load.total <= capacity(settings):
        return
    parts = ", ".join(f"{name} {cycles}" for name, cycles in load.parts().items())
    if settings.skin.present:
        raise SettingsError(
            "machine.clock_hz",
            f"{clock} cycles a second of {machine.cores} cores do not suffice for this skin, which "
            f"needs up to {load.total} ({parts}); share its {settings.skin.taxels} taxels among "
            "skin.controllers, use a lower skin.sampling_hz, or a faster machine",
        )
    raise SettingsError(
        "machine.clock_hz",
        f"{clock} cycles a second do not suffice for this node, which needs up to {load.total} "
        f"({parts}); use fewer than its {len(settings.taxel)} taxels, a lower sampling_Hz, a "
        "longer sampling.stretch_ms, or a faster machine",
    )
