"""What a node's settings answer to its commander, written down for another port."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin_sensor_node.firmware.commander import Refusal

from tests.unit.sensor_node.firmware.notation import described_settings

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments, State


class Answers:
    """Stands before what can be set, and writes down what it was asked and answered."""

    def __init__(self, controls: Any, answers: list[Any]) -> None:
        self._controls = controls
        self._answers = answers

    def apply(self, name: str, arguments: Arguments) -> State:
        asked = [name, described_settings({"": arguments})]
        try:
            state: State = self._controls.apply(name, arguments)
        except Refusal as refusal:
            self._answers.append({"asked": asked, "refusal": str(refusal)})
            raise
        self._answers.append({"asked": asked, "state": described_settings(state)})
        return state

    @property
    def state(self) -> State:
        state: State = self._controls.state
        self._answers.append({"asked": ["state", {}], "state": described_settings(state)})
        return state

    def restore(self, state: Any) -> State:
        asked = ["restore", described_settings(state)]
        now: State = self._controls.restore(state)
        self._answers.append({"asked": asked, "state": described_settings(now)})
        return now
