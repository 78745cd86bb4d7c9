"""What one kind of taxel is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar, get_args

from eskin_sensor_node.kinds.settings import TaxelSection

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.kinds.frontend import Frontend
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.signals import World

Sheet = TypeVar("Sheet", bound=TaxelSection)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind(Generic[Sheet]):
    """One kind of taxel, as `eskin_sensor_node.kinds.registry` lists it.

    Attributes:
        settings: Its ``[[taxel]]`` table, with the firmware's class that reads it.
        world: Draws the true parts of what is measured, from the data sheet and a generator of
            columns; of a kind whose taxels have places in a scenario's skin also from these.
        frontend: Draws the true parts of its analogue chain.
        samples_per_code: Where other taxels read it along, one code in so many is taken to be new.
        cycles: Of a sample's inversion, at least and at most, where ``machine/instructions.toml``
            has no count.
    """

    settings: type[Sheet]
    world: Callable[..., World]
    frontend: Callable[[Sheet, ColumnGenerator], Frontend]
    samples_per_code: int = 1
    cycles: tuple[int, int] | None = None

    @property
    def name(self) -> str:
        """The value of ``kind`` in a ``[[taxel]]`` table."""
        name: str = get_args(self.settings.model_fields["kind"].annotation)[0]
        return name

    @property
    def chain(self) -> str:
        """The measuring chain: the name of the firmware's module."""
        return self.settings.firmware.__module__.rpartition(".")[2]
