"""Remote control of a node of a large skin: the rate of all taxels, and whether it samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import CommandError
from eskin.wire.messages.command import WHOLE_NODE, Mode, place_of
from eskin_sensor_node.firmware import states
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments, State, Value
    from eskin_sensor_node.skin_node.node import SkinNode

_SETTINGS: Final = ("rate", "mode")
_MODES: Final = (Mode.SAMPLES, Mode.PEAKS)
_FASTER: Final = 2
"""Greatest rate over that of the design: pages hold as many rows, so stretches become shorter."""


class SkinControls:
    """Sets a node between two stretches; safe for several threads.

    ``set rate`` changes the period of all taxels. ``set mode=peaks`` stops sampling: the node sends
    no frames, and states a gap when ``set mode=samples`` resumes it. ``monitor`` defines or removes
    a monitor. ``reset`` restores the design.

    Args:
        node: The node.
    """

    def __init__(self, node: SkinNode) -> None:
        self._node = node
        self._designed = node.columns.period
        self._mode = Mode.SAMPLES

    def apply(self, name: str, arguments: Arguments) -> State:
        """Apply a command, whole or not at all.

        Args:
            name: ``calibrate``, ``set``, ``reset``, ``monitor`` or ``challenge``.
            arguments: As `eskin.wire.messages.command.check_arguments` allows.

        Returns:
            The node's state.

        Raises:
            CommandError: The node does not have that command, setting or place.
            MonitorError: The monitor cannot be used.
        """
        if name == "calibrate":
            raise CommandError("command", name, "set or reset: a skin keeps no baseline")
        if name == "monitor":
            with self._node.between_frames():
                self._node.reflexes.apply(arguments)
            return self.state
        if name == "challenge":
            self._node.challenge(str(arguments["nonce"]))
            return self.state
        place = place_of(arguments)
        if place != WHOLE_NODE:
            raise CommandError("taxel", place, "none: all taxels of a skin are sampled together")
        for field, value in arguments.items():
            if field not in _SETTINGS:
                raise CommandError(field, value, f"{' and '.join(_SETTINGS)} of a skin only")
        if arguments.get("mode", Mode.SAMPLES) not in _MODES:
            raise CommandError("mode", arguments["mode"], ", ".join(_MODES))
        if "rate" in arguments and not self._is_allowed(arguments["rate"]):
            most = _FASTER * BILLION / self._designed
            raise CommandError("rate", arguments["rate"], f"at most {most:g}")
        if name == "reset":
            arguments = {"rate": BILLION / self._designed, "mode": Mode.SAMPLES}
            with self._node.between_frames():
                self._node.reflexes.reset()
        self._set(arguments)
        return self.state

    def restore(self, state: State) -> State:
        """Restore the last reported state at boot, leaving out what no longer fits.

        Args:
            state: The last reported one; empty where there is none.

        Returns:
            The node's state.
        """
        settings = state.get(WHOLE_NODE, {})
        wanted: Arguments = {"mode": Mode.SAMPLES}
        if settings.get("mode") in _MODES:
            wanted["mode"] = settings["mode"]
        if "rate" in settings and self._is_allowed(settings["rate"]):
            wanted["rate"] = settings["rate"]
        self._set(wanted)
        with self._node.between_frames():
            self._node.reflexes.restore(state)
        return self.state

    def _set(self, arguments: Arguments) -> None:
        node = self._node
        period = _period(arguments["rate"]) if "rate" in arguments else node.columns.period
        if period != node.columns.period:
            with node.between_frames():
                node.columns.sample_every(period)
        self._mode = Mode(str(arguments.get("mode", self._mode)))
        if self._mode is Mode.PEAKS:
            node.shed(states.ORDERED)
        elif node.states.cause == states.ORDERED:
            node.resume()

    @property
    def state(self) -> State:
        """The node's state."""
        rate = BILLION / self._node.columns.period
        whole: State = {WHOLE_NODE: {"rate": rate, "mode": str(self._mode)}}
        return whole | self._node.reflexes.state

    def _is_allowed(self, rate: Value) -> bool:
        return _FASTER * _period(rate) >= self._designed


def _period(rate: Value) -> int:
    return round(BILLION / float(rate))
