"""What a node's firmware needs of its processor: cycles a second, by the prices of what it does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.machine.prices import BILLION, PRICES, inversion, message, passes
from eskin_sensor_node.machine.schedule import build_schedule

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.settings import NodeSettings

_HEAD: Final = 192
"""Bytes of a block besides its bounds, at most."""
_WIDTHS: Final = {"f64": 8, "f32": 4, "q16": 2}


@dataclass(frozen=True, slots=True)
class Load:
    """Cycles a second by purpose, at most, in mode ``samples`` while a viewer watches.

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
    each = [
        _taxel_load(settings, taxel, around.get(number, 0))
        for number, taxel in enumerate(settings.taxel)
    ]
    return Load(*(round(sum(part)) for part in zip(*each, strict=True)))


def _taxel_load(
    settings: NodeSettings, taxel: TaxelSection, neighbours: int
) -> tuple[float, float, float, float]:
    frame, rate = _sampled(settings, taxel)
    new = dict.fromkeys(taxel.companions, 0)
    sample: float = inversion(taxel.chain, 1, neighbours, new).most
    sample += sum(PRICES[f"new_{role}"].most / KINDS[role].samples_per_code for role in new)
    sought = [taxel.prominence(quantity) is not None for quantity in taxel.units]
    channels = sum(passes(rest=True, peaks=each).most for each in sought)
    size = 2 * frame * _WIDTHS[settings.sampling.encoding] + _HEAD
    block = message(size, settings.sampling.encoding, frame).most * len(sought)
    depth = settings.machine.dma_samples or frame
    handled = PRICES["frame"].most / frame + PRICES["interrupt"].most / min(depth, frame)
    return rate * sample, rate * channels, rate * block / frame, rate * handled


def _sampled(settings: NodeSettings, taxel: TaxelSection) -> tuple[int, float]:
    """Samples of a frame at least, and of a second; over its pauses, where it has some."""
    sampling = settings.sampling
    schedule = build_schedule(taxel, sampling.block_samples)
    most = schedule.block
    if sampling.watched_block_ms > 0.0:
        most = min(most, max(1, round(sampling.watched_block_ms * 1e6) // schedule.dt))
    if schedule.burst == 0:
        return most, BILLION / schedule.dt
    return min(most, schedule.burst), schedule.burst * BILLION / schedule.pause


def require_speed(settings: NodeSettings, around: Mapping[int, int]) -> None:
    """Check that the processor can keep up with the node.

    Raises:
        SettingsError: It needs more cycles a second than there are.
    """
    load, clock = processor_load(settings, around), settings.machine.clock_hz
    if load.total <= clock:
        return
    parts = ", ".join(f"{name} {cycles}" for name, cycles in load.parts().items())
    raise SettingsError(
        "machine.clock_hz",
        f"{clock} cycles a second do not suffice for this node, which needs up to {load.total} "
        f"({parts}); use fewer than its {len(settings.taxel)} taxels, a lower sampling_Hz, a "
        "longer sampling.watched_block_ms or sampling.block_samples, or a faster machine",
    )
