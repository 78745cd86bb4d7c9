"""The ``[skin]`` table of a node: a large skin of equal pads in place of ``[[taxel]]`` tables."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, TypeVar

from pydantic import Field, ValidationError, field_validator, model_validator

from eskin.errors import ScenarioError, shown, unprefixed
from eskin.runtime.settings import Section
from eskin_sensor_node.kinds.hygrometer import HygrometerSection
from eskin_sensor_node.kinds.pad import PadSection
from eskin_sensor_node.kinds.settings import Companion, Rate, TaxelSection, period
from eskin_sensor_node.kinds.thermometer import ThermometerSection
from eskin_sensor_node.timebase import BILLION
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.world.skin import Skin

MOST_TAXELS: Final = 20_000
"""Of a skin; as many fit into one layout message of 64 KiB, with their patches and seams."""
MOST_ROWS: Final = 1000
_FIRST: Final = 1 << 31
"""Number of the first sensor that is read along."""
_PATCH: Final = 64
"""Taxels of a patch, which no cut goes through."""
_THERMOMETER: Final = "thermometer"
_HYGROMETER: Final = "hygrometer"
_AIR: Final[Mapping[str, type[TaxelSection]]] = {
    _THERMOMETER: ThermometerSection,
    _HYGROMETER: HygrometerSection,
}
Table: TypeAlias = "dict[str, Any]"
Sheet = TypeVar("Sheet", bound=TaxelSection)


class SkinSection(Section):
    """A skin of one node, or its share of a skin that several nodes sample."""

    scenario: str = Field(
        default="",
        description="scenario whose skin the node samples, each taxel of it; a file, or a packaged "
        "one, such as paper-hand.toml; empty: the node has `[[taxel]]` tables instead",
    )
    sampling_hz: Rate = Field(default=50.0, description="samples of each taxel a second")
    stretch_ms: float = Field(
        default=100.0, ge=1, le=10_000, description="length of a stretch of time, one frame a page"
    )
    threshold_pa: float = Field(
        default=5e3, gt=0, lt=1e9, description="pressure from which on there is a contact, Pa"
    )
    controllers: tuple[str, ...] = Field(
        default=(),
        max_length=64,
        description="names of all nodes that share the skin, in order, this one included; empty: "
        "this node samples all of it",
    )
    pad: Table = Field(
        default={}, description="data sheet of each taxel: keys of a `[[taxel]]` of kind pad"
    )
    thermometer: Table = Field(
        default={},
        description="data sheet of a thermometer that all taxels read along; empty: none",
    )
    hygrometer: Table = Field(
        default={}, description="data sheet of a hygrometer that all taxels read along; empty: none"
    )

    @field_validator("scenario")
    @classmethod
    def _scenario_is_unicode(cls, value: str) -> str:
        try:
            value.encode()
        except UnicodeEncodeError:  # pydantic cannot write what quotes it
            raise ValueError("its name is no UTF-8; rename the file") from None
        return value

    @field_validator("controllers")
    @classmethod
    def _controllers_are_unique(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        twice = sorted({name for name in value if value.count(name) > 1})
        if twice:
            raise ValueError(f"the same node twice: {', '.join(twice)}")
        return value

    @model_validator(mode="after")
    def _can_be_sampled(self) -> Self:
        if not self.present:
            return self
        try:
            taxels = len(self.skin)
        except ScenarioError as error:
            raise ValueError(f"scenario: {error}") from error
        if taxels > MOST_TAXELS:
            raise ValueError(
                f"scenario {self.scenario} has {taxels} taxels; at most {MOST_TAXELS} are allowed"
            )
        if len(self.controllers) > taxels:
            raise ValueError(f"{len(self.controllers)} controllers share {taxels} taxels")
        if not 1 <= self.rows <= MOST_ROWS or self.rows * self.period != self.stretch:
            raise ValueError(
                f"stretch_ms = {self.stretch_ms:g} must be 1 to {MOST_ROWS} periods of sampling_hz "
                f"= {self.sampling_hz:g}"
            )
        if self.taxel.adaptive or self.taxel.actuator_steps:
            raise ValueError("pad.adaptive and pad.actuator_steps: a skin's pads are not adjusted")
        _ = self.air
        self._require_sound()
        return self

    def _require_sound(self) -> None:
        """Refuse more stuck taxels around one than its data sheet allows for."""
        skin, doubtful = self.skin, self.taxel.doubtful_neighbours
        stuck = {f.taxel for f in read_scenario(self.scenario).fault if f.kind == "stuck"}
        counts: dict[int, int] = {}
        for name in stuck:
            around = skin.neighbours[skin.numbers[name]]
            for number in around[around != NO_NEIGHBOUR].tolist():
                counts[number] = counts.get(number, 0) + 1
        for number, count in sorted(counts.items()):
            if count > doubtful:
                raise ValueError(
                    f"{count} neighbours of {skin.names[number]} get stuck in the scenario, "
                    f"pad.doubtful_neighbours is {doubtful}"
                )

    @property
    def present(self) -> bool:
        """Whether the node has a skin."""
        return bool(self.scenario)

    @property
    def skin(self) -> Skin:
        """Where its taxels sit."""
        return read_scenario(self.scenario).skin.build()

    @property
    def taxels(self) -> int:
        """How many this node samples, at most: its share, where several nodes share the skin."""
        return -(-len(self.skin) // max(len(self.controllers), 1)) + bool(self.controllers) * _PATCH

    @property
    def period(self) -> int:
        """From sample to sample of a taxel, ns."""
        return period(self.sampling_hz)

    @property
    def stretch(self) -> int:
        """Length of a stretch, ns."""
        return round(self.stretch_ms * 1e-3 * BILLION)

    @property
    def rows(self) -> int:
        """Samples of a taxel in a stretch."""
        return round(self.stretch / self.period)

    @cached_property
    def taxel(self) -> PadSection:
        """The data sheet of each taxel, at the place of the first one."""
        named = {role: role for role in _AIR if getattr(self, role)}
        place = self.skin.names[0]
        return _read(
            "pad",
            PadSection,
            self.pad | named,
            id=place,
            place=place,
            kind="pad",
            scenario=self.scenario,
            sampling_Hz=self.sampling_hz,
        )

    @cached_property
    def air(self) -> dict[str, TaxelSection]:
        """The sensors that all taxels read along, by the names of their inputs."""
        return {
            role: _read(
                role,
                section,
                getattr(self, role),
                id=role,
                kind=role,
                scenario=self.scenario,
                sampling_Hz=self.sampling_hz,
            )
            for role, section in _AIR.items()
            if getattr(self, role)
        }

    @property
    def companions(self) -> dict[str, Companion]:
        """The same as a taxel's companions; their numbers come after those of all taxels."""
        return {
            role: Companion(sensor, _FIRST + number)
            for number, (role, sensor) in enumerate(self.air.items())
        }


def _read(role: str, section: type[Sheet], given: Table, /, **own: object) -> Sheet:
    """Read a data sheet.

    Raises:
        ValueError: A key is unknown, missing or not allowed, or one that the skin sets.
    """
    for key in own.keys() & given.keys():
        raise ValueError(f"{role}.{key} is set by the skin; leave it out")
    try:
        return section.model_validate(given | own)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join([role, *map(str, first["loc"])])
        if first["type"] == "missing":
            raise ValueError(f"{place} is missing; it has no default") from error
        if first["type"] == "extra_forbidden":
            raise ValueError(f"{place}: no such key; check its spelling") from error
        raise ValueError(
            f"{place} = {shown(first['input'])}: {unprefixed(first['msg'])}"
        ) from error
