"""A scenario as it is written: what touches what, when."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pydantic import ConfigDict, Field

from eskin.runtime.settings import Section
from eskin_sensor_node.world.scenario.events import ApproachEvent, Event, NoiseEvent
from eskin_sensor_node.world.scenario.surroundings import AmbientSection, BioelectricSection
from eskin_sensor_node.world.skin import (
    FaultSection,
    FilmSection,
    HysteresisSection,
    Shape,
    WearSection,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats


class VariationSection(Section):
    """How much the seed changes each contact from how it is written, evenly up to both sides."""

    model_config = ConfigDict(strict=True)

    time_s: float = Field(default=0.0, ge=0, description="when it begins, within the scenario")
    force: float = Field(default=0.0, ge=0, lt=1, description="its force, relative")
    position_m: float = Field(default=0.0, ge=0, description="its place, along the skin")


class Departure(NamedTuple):
    """What takes a taxel out of its data sheet: intervals of causes need not hold any more.

    Attributes:
        taxel: Its name; empty: all pads.
        kind: ``stuck``, ``dead``, ``worn``, ``wet`` or ``hysteresis``.
        begin_s: From when on.
        end_s: Until when; ``inf``: for good.
    """

    taxel: str
    kind: str
    begin_s: float = 0.0
    end_s: float = inf

    def __str__(self) -> str:
        until = "" if self.end_s == inf else f" to {self.end_s:g} s"
        return f"{self.taxel or 'all pads'}: {self.kind} from {self.begin_s:g} s{until}"


class Script(Section):
    """A scenario file."""

    model_config = ConfigDict(strict=True)

    description: str = Field(max_length=200, description="one line for people")
    duration_s: float = Field(gt=0, le=86_400, description="how long it lasts")
    repeat: bool = Field(
        default=False,
        description="whether a node that comes to the end begins anew, with other variations; else "
        "nothing more happens",
    )
    seed: int = Field(
        default=0, ge=0, lt=2**63, description="draws the variations where nothing else does"
    )
    skin: Shape = Field(description="where the taxels sit")
    ambient: AmbientSection = Field(default=AmbientSection(), description="the air")
    bioelectric: BioelectricSection = Field(
        default=BioelectricSection(), description="a voltage that the body makes"
    )
    variation: VariationSection = Field(
        default=VariationSection(), description="what the seed changes"
    )
    event: list[Event] = Field(default=[], max_length=10_000, description="what happens")
    fault: list[FaultSection] = Field(default=[], description="which taxels break")
    wear: list[WearSection] = Field(default=[], description="which pads wear")
    film: list[FilmSection] = Field(default=[], description="on which pads water lies")
    hysteresis: HysteresisSection = Field(
        default=HysteresisSection(), description="what remains of a pad's compression"
    )
    pad: dict[str, Any] = Field(
        default={}, description="data sheet of the capacitive taxels of a dataset"
    )
    coil: dict[str, Any] = Field(
        default={}, description="data sheet of the inductive taxels of a dataset"
    )
    thermometer: dict[str, Any] = Field(
        default={}, description="data sheet of the thermometer of a dataset"
    )
    hygrometer: dict[str, Any] = Field(
        default={}, description="data sheet of the hygrometer of a dataset"
    )
    electrode: dict[str, Any] = Field(
        default={}, description="data sheet of the bioelectric taxel of a dataset"
    )

    def local(self, seconds: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Number of the loop, and the time within it, at times in s since the start."""
        if not self.repeat:
            return np.zeros(seconds.shape, np.int64), seconds
        loops = np.maximum(np.floor(seconds / self.duration_s), 0.0).astype(np.int64)
        return loops, seconds - loops * self.duration_s

    @property
    def departures(self) -> list[Departure]:
        """What takes taxels out of their data sheets; what changes more of them comes later."""
        remains = [Departure("", "hysteresis")] if self.hysteresis.share > 0.0 else []
        worn = [Departure(each.taxel, "worn", each.at_s) for each in self.wear]
        wet = [
            Departure(each.taxel, "wet", each.at_s, each.at_s + each.duration_s)
            for each in self.film
        ]
        broken = [Departure(each.taxel, each.kind, each.at_s) for each in self.fault]
        return [*remains, *worn, *wet, *broken]

    @property
    def peak_pressure(self) -> float:
        """Greatest pressure in Pa that contacts may make where they meet, with all variations."""
        spans = [
            (begin, begin + event.duration_s, event.pressure)
            for event in self.event
            if not isinstance(event, ApproachEvent | NoiseEvent)
            for begin in event.begins
        ]
        if not spans:
            return 0.0
        begins, ends, pressures = np.array(spans).T
        slack = self.variation.time_s
        instants = np.concatenate([begins - slack, ends + slack])
        changes = np.concatenate([pressures, -pressures])
        # At one instant the next contact begins before the last one ends.
        order = np.lexsort((-changes, instants))
        together = float(np.cumsum(changes[order]).max())
        return together * (1.0 + self.variation.force)
