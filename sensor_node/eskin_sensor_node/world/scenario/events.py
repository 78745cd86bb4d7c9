"""What may happen to a skin: the ``[[event]]`` tables of a scenario.

A contact presses with a mean pressure on a round patch. Both follow the course ``s(t)`` of its
force, which is 1 at most, as Hertz has it for two elastic bodies: the patch's area grows with
``s^(2/3)`` and the pressure with ``s^(1/3)``, so that their product is the force.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, Self, TypeAlias

import numpy as np
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from eskin.runtime.settings import Section

if TYPE_CHECKING:
    from eskin.interval import Floats

Positive: TypeAlias = Annotated[float, Field(gt=0)]
TaxelName: TypeAlias = Annotated[str, Field(pattern=r"^t[0-9]{2,6}$")]


AWAY: Final = 1.0
"""Distance in m at which metal rests, and from which it comes: too far to be seen."""


class _Event(Section):
    """What all events have."""

    model_config = ConfigDict(strict=True)

    at_s: float = Field(ge=0, description="when it begins")
    duration_s: Positive = Field(description="how long it lasts")
    times: int = Field(default=1, ge=1, le=10_000, description="how often it happens")
    every_s: Positive | None = Field(
        default=None, description="from one begin to the next; needed where it happens often"
    )

    @field_validator("every_s")
    @classmethod
    def _one_after_the_other(cls, value: float | None, info: ValidationInfo) -> float | None:
        duration = info.data.get("duration_s")
        if value is not None and duration is not None and value < duration:
            raise ValueError(f"it must be at least duration_s = {duration!r}")
        return value

    @model_validator(mode="after")
    def _often_has_a_period(self) -> Self:
        if self.times > 1 and self.every_s is None:
            raise ValueError("times > 1 needs every_s")
        return self

    @property
    def begins(self) -> tuple[float, ...]:
        """When it begins, each time, in s."""
        return tuple(self.at_s + number * (self.every_s or 0.0) for number in range(self.times))

    @property
    def end_s(self) -> float:
        """When it is over for the last time."""
        return self.begins[-1] + self.duration_s

    @property
    def taxels(self) -> tuple[str, ...]:
        """Names of the taxels that it refers to."""
        return ()


class _Contact(_Event):
    """Something elastic that touches the skin."""

    force_N: Positive = Field(description="greatest force")
    radius_m: Positive = Field(description="radius of the patch at the greatest force")

    @property
    def pressure(self) -> float:
        """Mean pressure on the patch at the greatest force, in Pa."""
        return float(self.force_N / (np.pi * self.radius_m**2))

    @abstractmethod
    def course(self, since: Floats) -> Floats:
        """Share of the greatest force at times in s since its begin, 0 outside."""


class _Spot(_Contact):
    """A contact that stays where it is."""

    at: TaxelName = Field(description="the taxel in its middle, such as t05")

    @property
    def taxels(self) -> tuple[str, ...]:
        """The one in its middle."""
        return (self.at,)


class _Ramped(_Contact):
    """A contact that comes, stays with its force, and goes."""

    rise_s: Positive = Field(default=0.1, description="how long it comes, and how long it goes")

    @field_validator("rise_s")
    @classmethod
    def _fits(cls, value: float, info: ValidationInfo) -> float:
        return _half(value, info)

    def course(self, since: Floats) -> Floats:
        """Raised cosine up, 1, raised cosine down."""
        return ramped(since, self.duration_s, self.rise_s)


class TapEvent(_Spot):
    """Short: half a sine of force."""

    LABEL: ClassVar = "tap"
    kind: Literal["tap"]

    def course(self, since: Floats) -> Floats:
        """Half a sine."""
        share = np.sin(np.pi * since / self.duration_s)
        return np.where((since >= 0.0) & (since <= self.duration_s), np.maximum(share, 0.0), 0.0)


class PressEvent(_Spot):
    """Force that rises to its greatest and falls again at once: a raised cosine."""

    LABEL: ClassVar = "press"
    kind: Literal["press"]

    def course(self, since: Floats) -> Floats:
        """A raised cosine."""
        return ramped(since, self.duration_s, self.duration_s / 2.0)


class HoldEvent(_Ramped, _Spot):
    """A contact that stays: a ramp, its force, a ramp."""

    LABEL: ClassVar = "hold"
    kind: Literal["hold"]


class SlideEvent(_Ramped):
    """A contact that moves at a constant pace from taxel to taxel, in straight lines."""

    LABEL: ClassVar = "slide"
    kind: Literal["slide"]
    path: list[TaxelName] = Field(
        min_length=2, max_length=100, description='taxels on its way, such as ["t00", "t03"]'
    )

    @property
    def taxels(self) -> tuple[str, ...]:
        """Those on its way."""
        return tuple(self.path)


class ApproachEvent(_Event):
    """Metal that comes near, stays, and goes, from and to a distance of 1 m; it touches nothing."""

    LABEL: ClassVar = "approach"
    kind: Literal["approach"]
    at: TaxelName = Field(description="the taxel that it comes near, along its normal")
    near_m: float = Field(gt=0, lt=AWAY, description="least distance")
    rise_s: Positive = Field(default=0.5, description="how long it comes, and how long it goes")
    quality: float = Field(
        default=10.0,
        ge=2,
        le=1000,
        description="reactance over resistance of the metal's eddy currents: copper 10, steel 2",
    )

    @field_validator("rise_s")
    @classmethod
    def _fits(cls, value: float, info: ValidationInfo) -> float:
        return _half(value, info)

    reach_m: Positive = Field(default=0.1, description="taxels nearer than this are labelled")

    @property
    def taxels(self) -> tuple[str, ...]:
        """The one that it comes near."""
        return (self.at,)

    def height(self, since: Floats) -> Floats:
        """Distance in m at times in s since its begin, `AWAY` outside."""
        return AWAY + (self.near_m - AWAY) * ramped(since, self.duration_s, self.rise_s)


class NoiseEvent(_Event):
    """A stretch in which nothing may touch the skin or come near: noise only."""

    LABEL: ClassVar = "noise"
    kind: Literal["noise"]


AnyEvent: TypeAlias = TapEvent | PressEvent | HoldEvent | SlideEvent | ApproachEvent | NoiseEvent
"""An event of any kind."""

ContactEvent: TypeAlias = TapEvent | PressEvent | HoldEvent | SlideEvent
"""An event that touches the skin."""

Event: TypeAlias = Annotated[AnyEvent, Field(discriminator="kind")]
"""The same, discriminated by ``kind``."""

LABELS: Final = ("noise", "tap", "press", "hold", "slide", "approach")
"""What a sample may be labelled with; the first one where nothing happens."""


def ramped(since: Floats, duration: float, rise: float) -> Floats:
    """0 before, a raised cosine to 1 over the rise, 1, the same back to 0 at the end."""
    nearest = np.minimum(since, duration - since)
    share = np.clip(nearest / rise, 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * share))


def _half(value: float, info: ValidationInfo) -> float:
    """Refuse to come and go for longer than the event lasts."""
    duration = info.data.get("duration_s")
    if duration is not None and value > duration / 2.0:
        raise ValueError(f"it must be at most half of duration_s = {duration!r}")
    return value
