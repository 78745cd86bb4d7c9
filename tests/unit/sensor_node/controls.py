"""What can be set of a node in tests: a simple one that does what it is notified."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import CommandError
from eskin.wire.messages.command import SETTINGS, WHOLE_NODE, place_of

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments, State

FASTEST = 1000.0


class SimpleControls:
    """Two taxels that can be set; counts its calls.

    ``baselines`` counts calibrations: the effect that shows best whether it came once.
    """

    def __init__(self) -> None:
        self.state = self._first()
        self.calls: list[tuple[str, Arguments]] = []

    def apply(self, name: str, arguments: Arguments) -> State:
        self.calls.append((name, dict(arguments)))
        if name == "reset":
            self.state = self._first()
            return self.state
        rate = arguments.get("rate", 0.0)
        if isinstance(rate, float) and rate > FASTEST:
            raise CommandError("rate", rate, f"at most {FASTEST:g}\nat this taxel")
        place = place_of(arguments)
        for where in ("t01", "t02") if place == WHOLE_NODE else (place,):
            found = self.state.setdefault(where, {})
            if name == "calibrate":
                baselines = found.get("baselines", 0.0)
                assert isinstance(baselines, float)
                found["baselines"] = baselines + 1.0
            found |= {field: value for field, value in arguments.items() if field in SETTINGS}
        return self.state

    def restore(self, state: State) -> State:
        for place, settings in state.items():
            self.state.setdefault(place, {}).update(settings)
        return self.state

    @staticmethod
    def _first() -> State:
        return {"t01": {"rate": 100.0}, "t02": {"rate": 100.0}}
