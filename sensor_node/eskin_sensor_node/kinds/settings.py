"""What all taxels have, and how their keys are written.

Keys carry their SI unit. A tolerance is relative: the true part lies anywhere inside
``value · [1 - tolerance, 1 + tolerance]``, and this is all that the firmware knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, TypeAlias

from pydantic import AfterValidator, ConfigDict, Field, ValidationInfo

from eskin.runtime.settings import Section
from eskin.union_bound import union_coverage
from eskin_sensor_node.firmware.taxel.taxel import Taxel
from eskin_sensor_node.kinds.noise import Noise
from eskin_sensor_node.timebase import BILLION

Tolerance: TypeAlias = Annotated[float, Field(ge=0, lt=0.5)]
Positive: TypeAlias = Annotated[float, Field(gt=0)]


def period(hertz: float) -> int:
    """Sampling period in ns."""
    return round(BILLION / hertz)


def _whole_period(hertz: float) -> float:
    if abs(period(hertz) * hertz - BILLION) > 1e-6 * BILLION:
        raise ValueError("the sampling period must be a whole number of nanoseconds")
    return hertz


Rate: TypeAlias = Annotated[float, Field(ge=1e-6, le=1e6), AfterValidator(_whole_period)]

Place: TypeAlias = Annotated[float, Field(strict=True, ge=-100, le=100, allow_inf_nan=False)]


def unit(alias: str, default: Any = ..., **limits: Any) -> Any:
    """A field whose key in the file carries a unit that is no Python name."""
    return Field(default, alias=alias, **limits)


def above(info: ValidationInfo, value: float, key: str, name: str) -> float:
    """Refuse an upper end that is not above its lower end."""
    lower = info.data.get(name)
    if lower is not None and value <= lower:
        raise ValueError(f"it must be greater than {key} = {lower!r}")
    return value


class TaxelSection(Section):
    """What all taxels have."""

    model_config = ConfigDict(strict=True)

    firmware: ClassVar[type[Taxel]]
    """What the control unit knows of it: inputs, quantities, calibration."""
    pressed: ClassVar[bool] = False
    """Whether contacts press it, and its neighbours feel a share."""
    disturbances: ClassVar[int] = 1
    """How many independent noises disturb one interval, at most."""

    if TYPE_CHECKING:
        # Each kind has these, as keys with limits and defaults of its own, or as properties.

        @property
        def kind(self) -> str:
            """Name of its kind."""

        @property
        def sampling(self) -> float:
            """Samples in a second."""

        @property
        def adc_min(self) -> float:
            """Lower end of its converter's range."""

        @property
        def adc_max(self) -> float:
            """Upper end of its converter's range."""

    id: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,30}$",
        description="such as t01; all that one beginning with bio- measures identifies a person",
    )
    noise: Noise = Field(description="disturbance of the measurement")
    position: tuple[Place, Place] | None = unit(
        "position_m",
        None,
        strict=False,
        description="x and y of its centre on a flat map of the skin; a pad or a coil takes its "
        "scenario's",
    )
    adc_bits: int = Field(default=12, ge=4, le=24, description="the converter's resolution")
    adc_gain_error: Tolerance = 0.0
    adc_offset_error: float = Field(default=0.0, ge=0, le=1000, description="in steps")
    adc_nonlinearity: float = Field(default=0.0, ge=0, le=1000, description="INL, in steps")
    gain_tolerance: Tolerance = Field(default=0.0, description="of the amplifier before it")
    trimmer_steps: int = Field(
        default=0, ge=0, le=10_000, description="steps, either way, of an offset before it; 0: none"
    )
    trimmer_step: float = Field(
        default=0.0625, gt=0, le=1, description="size of one, as a share of the converter's range"
    )
    trimmer_tolerance: Tolerance = Field(default=1e-4, description="of the offset")
    adaptive: bool = Field(
        default=False, description="whether the node sets gain, trimmer and plates by itself"
    )
    gain_least: float = Field(default=1.0, ge=1e-3, le=1, description="least gain that it sets")
    gain_most: float = Field(default=8.0, ge=1, le=1e3, description="greatest gain that it sets")
    longest_region_s: float = Field(
        default=5.0, gt=0, description="after this time an undecided stretch is reported"
    )

    @property
    def units(self) -> dict[str, str]:
        """Quantity to UCUM unit, in the order of its channels."""
        return dict(self.firmware.quantities)

    @property
    def chain(self) -> str:
        """The measuring chain: the name of the firmware's module."""
        return self.firmware.__module__.rpartition(".")[2]

    @property
    def burst(self) -> tuple[float, float] | None:
        """Length and period in s of its bursts; ``None``: it samples all the time."""
        return None

    @property
    def coverage(self) -> float:
        """Probability that a sample's interval holds the truth, at least."""
        return union_coverage(self.noise.coverage, n=self.disturbances)

    @property
    def companions(self) -> dict[str, str]:
        """What it reads along, at its own instants, to the id of that taxel of its node."""
        return {}

    def contact_of(self, quantity: str) -> ContactPlace | None:
        """Where on a skin a quantity shows contacts; ``None`` if it does not."""
        del quantity
        return None

    def prominence(self, quantity: str) -> float | None:
        """Least prominence of a peak, in the channel's unit; ``None``: peaks are not sought."""
        value: float | None = getattr(self, f"{quantity}_prominence")
        return value

    @property
    def prominences(self) -> dict[str, float]:
        """Of each quantity in which peaks are sought."""
        found = {quantity: self.prominence(quantity) for quantity in self.units}
        return {quantity: least for quantity, least in found.items() if least is not None}


class ContactPlace(NamedTuple):
    """A taxel's place on a skin whose pressures show contacts.

    Attributes:
        scenario: Whose skin it is.
        threshold: Pressure from which on there is a contact, Pa.
        place: Its taxel of that skin.
    """

    scenario: str
    threshold: float
    place: str


@dataclass(frozen=True, slots=True)
class Companion:
    """A taxel of the same node, read at the instants of another one.

    Attributes:
        taxel: Its settings.
        number: Its own among the node's: it draws the same parts for each taxel that reads it.
    """

    taxel: TaxelSection
    number: int
