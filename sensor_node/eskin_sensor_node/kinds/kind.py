"""What one kind of taxel is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar, get_args

from eskin_sensor_node.kinds.settings import TaxelSection

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    from eskin_sensor_node.kinds.frontend import Frontend
    from eskin_sensor_node.kinds.signals import World

Sheet = TypeVar("Sheet", bound=TaxelSection)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind(Generic[Sheet]):
    """One kind of taxel, as `eskin_sensor_node.kinds.registry` lists it.

    Attributes:
        settings: Its ``[[taxel]]`` table, with the firmware's class that reads it.
        world: Draws the true parts of what is measured.
        frontend: Draws the true parts of its analogue chain.
        skin_world: Draws those of what is measured at many places of a skin, a column each, where
            the kind can be sampled so.
        in_columns: Whether its world is formulas alone, so that a fleet calculates all nodes at
            once; other worlds play a scenario or a recording.
        samples_per_code: Where other taxels read it along, one code in so many is taken to be new.
        cycles: Of a sample's inversion, at least and at most, where ``machine/instructions.toml``
            has no count.
    """

    settings: type[Sheet]
    world: Callable[[Sheet, np.random.Generator], World]
    frontend: Callable[[Sheet, np.random.Generator], Frontend]
    skin_world: Callable[[Sheet, np.random.Generator, Sequence[str]], World] | None = None
    in_columns: bool = False
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
