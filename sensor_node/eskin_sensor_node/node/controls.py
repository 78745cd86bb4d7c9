"""Remote control of a node, in the terms of robot skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import CommandError
from eskin.wire.frames.sample_codec import MOST_STRIDE
from eskin.wire.messages.command import WHOLE_NODE, Mode, place_of
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.wire.messages.command import Arguments, State, Value
    from eskin_sensor_node.node.node import Node
    from eskin_sensor_node.node.taxel import EmulatedTaxel

_OF_TAXEL: Final = ("adaptive", "gain", "smoothing", "rate", "mode")


class NodeControls:
    """Sets a node between two frames; safe for several threads.

    Args:
        node: The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._taxels = {taxel.name: taxel for taxel in node.taxels}

    def apply(self, name: str, arguments: Arguments) -> State:
        """Apply a command, whole or not at all.

        Args:
            name: ``calibrate``, ``set``, ``reset``, ``monitor`` or ``challenge``.
            arguments: As `eskin.wire.messages.command.check_arguments` allows.

        Returns:
            The node's state.

        Raises:
            CommandError: No such taxel or channel, or the rate is too high for it.
            MonitorError: The monitor cannot be used.
        """
        if name == "monitor":
            with self._node.between_frames():
                self._node.reflexes.apply(arguments)
            return self.state
        if name == "challenge":
            self._node.challenge(str(arguments["nonce"]))
            return self.state
        taxels = self._chosen(place_of(arguments))
        if "rate" in arguments:
            for taxel in taxels:
                _require_rate(taxel, arguments["rate"])
            self._require_powers(taxels, arguments["rate"])
        with self._node.between_frames():
            for taxel in taxels:
                if name == "calibrate":
                    taxel.control_unit.calibrate()
                elif name == "reset":
                    taxel.reset()
                else:
                    _set(taxel, arguments)
            if name == "reset":
                self._node.reflexes.reset()
        return self.state

    def _require_powers(self, taxels: Sequence[EmulatedTaxel], rate: Value) -> None:
        """Check that taxels of a patch can be sampled on one grid.

        Raises:
            CommandError: A period is no other one of its patch times a power of two.
        """
        dt = _period(rate)
        for taxel in taxels:
            for other in self._beside(taxel):
                found = dt if other in taxels else other.control_unit.schedule.dt
                if not _is_power(max(found, dt), min(found, dt)):
                    raise CommandError(
                        "rate",
                        rate,
                        f"{BILLION / found:g}, at which {other.name} is sampled in one patch with "
                        f"{taxel.name}, times or divided by a power of two; or set all of them",
                    )

    def _beside(self, taxel: EmulatedTaxel) -> list[EmulatedTaxel]:
        """The taxels that share a patch with one."""
        patches = {unit.patch for unit in taxel.control_unit.units}
        return [
            other
            for other in self._taxels.values()
            if any(unit.patch in patches for unit in other.control_unit.units)
        ]

    def restore(self, state: State) -> State:
        """Restore the last reported state at boot, leaving out what no longer fits.

        Args:
            state: The last reported one; empty where there is none.

        Returns:
            The node's state.
        """
        with self._node.between_frames():
            self._node.reflexes.restore(state)
            for place, settings in state.items():
                taxel = self._taxels.get(place.partition(".")[0])
                if taxel is not None:
                    _restore(taxel, place, settings)
            for taxel in self._taxels.values():
                try:
                    self._require_powers([taxel], BILLION / taxel.control_unit.schedule.dt)
                except CommandError:
                    taxel.sample_every(taxel.control_unit.designed.dt)
        return self.state

    def _chosen(self, place: str) -> list[EmulatedTaxel]:
        if place == WHOLE_NODE:
            return list(self._taxels.values())
        name, _, quantity = place.partition(".")
        taxel = self._taxels.get(name)
        if taxel is None:
            raise CommandError("taxel", name, ", ".join(self._taxels))
        channels = [unit.name for unit in taxel.control_unit.units]
        if quantity and place not in channels:
            raise CommandError("channel", place, ", ".join(channels))
        return [taxel]

    @property
    def state(self) -> State:
        """The node's state."""
        state: State = {}
        for name, taxel in self._taxels.items():
            unit = taxel.control_unit
            state[name] = {
                "adaptive": "on" if unit.adaptive else "off",
                "gain": unit.adaptation.gain,
                "smoothing": unit.smoothing,
                "rate": BILLION / unit.schedule.dt,
                "mode": unit.mode,
            }
            for channel in unit.units:
                if channel.threshold > 0.0:
                    state[channel.name] = {"threshold": channel.threshold}
        return state | self._node.reflexes.state


def _set(taxel: EmulatedTaxel, arguments: Arguments) -> None:
    unit = taxel.control_unit
    if "threshold" in arguments:
        names = [each.name for each in unit.units]
        k = names.index(str(arguments["channel"]))
        unit.set_threshold(k, float(arguments["threshold"]))
    if "adaptive" in arguments:
        taxel.adapt(on=arguments["adaptive"] == "on")
    if "gain" in arguments:
        taxel.amplify(float(arguments["gain"]))
    if "smoothing" in arguments:
        unit.smooth(float(arguments["smoothing"]))
    if "rate" in arguments:
        taxel.sample_every(_period(arguments["rate"]))
    if "mode" in arguments:
        unit.mode = str(arguments["mode"])


def _restore(taxel: EmulatedTaxel, place: str, settings: dict[str, Value]) -> None:
    unit = taxel.control_unit
    arguments = {key: value for key, value in settings.items() if key in _OF_TAXEL}
    if arguments.get("mode") not in (None, *Mode):
        del arguments["mode"]
    if "rate" in arguments and not _is_allowed(taxel, arguments["rate"]):
        del arguments["rate"]
    if place in [each.name for each in unit.units] and "threshold" in settings:
        arguments = {"channel": place, "threshold": settings["threshold"]}
    if arguments.get("adaptive") == ("on" if unit.adaptive else "off"):
        del arguments["adaptive"]
    # What is as designed needs no change, and costs no peaks.
    if arguments.get("rate") == BILLION / unit.schedule.dt:
        del arguments["rate"]
    _set(taxel, arguments)


def _is_power(longer: int, shorter: int) -> bool:
    """Whether a period is another one times a power of two that a frame can state."""
    times, rest = divmod(longer, shorter)
    return rest == 0 and times.bit_count() == 1 and times <= 1 << MOST_STRIDE


def _period(rate: Value) -> int:
    return round(BILLION / float(rate))


def _is_allowed(taxel: EmulatedTaxel, rate: Value) -> bool:
    return _period(rate) >= taxel.control_unit.designed.dt


def _require_rate(taxel: EmulatedTaxel, rate: Value) -> None:
    if not _is_allowed(taxel, rate):
        most = BILLION / taxel.control_unit.designed.dt
        raise CommandError("rate", rate, f"at most {most:g}, for which {taxel.name} was designed")
