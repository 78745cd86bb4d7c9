"""Commands at the node: verified, executed once, in time, answered; and what they set."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Protocol

from eskin.errors import CommandError, EnvelopeError, EskinError, FlashError, IdentityError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.identity.identity import ROOT_FILE
from eskin.runtime.printable import printable
from eskin.wire.envelope import Verifier
from eskin.wire.frames.sample_codec import MOST_STRIDE
from eskin.wire.messages import Outcome
from eskin.wire.messages.command import WHOLE_NODE, CommandName, Mode, check_arguments, place_of
from eskin.wire.timestamp import LATEST, SECOND
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.firmware import commander
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.identity import Identity
    from eskin.wire.messages.command import Arguments, State, Value
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.node.node import Node
    from eskin_sensor_node.node.taxel import EmulatedTaxel

log = logging.getLogger(__name__)

_MOST_SECONDS: Final = LATEST // SECOND
_OF_TAXEL: Final = ("adaptive", "gain", "smoothing", "rate", "mode")


class TypedControls(Protocol):
    """A node's settings; called by the thread that takes commands."""

    def apply(self, name: str, arguments: Arguments) -> State:
        """Apply a command, whole or not at all.

        Args:
            name: ``calibrate``, ``set``, ``reset``, ``monitor`` or ``challenge``.
            arguments: As `eskin.wire.messages.command.check_arguments` allows.

        Returns:
            The node's state: the settings of each place (channel, taxel, or ``*``).

        Raises:
            EskinError: It cannot be applied; the message has the value and the reason.
        """

    def restore(self, state: State) -> State:
        """Restore the last reported state at boot, leaving out what no longer fits.

        Args:
            state: The last reported one; empty where there is none.

        Returns:
            The node's state.
        """

    @property
    def state(self) -> State:
        """The node's state."""


class CommandReceiver:
    """Verifies commands of the cloud; the firmware executes them.

    Args:
        outbox: Stores the last command's result.
        own: The node's identity.
        cloud: Common name of the only server that may command.
        controls: What can be set.
        enclosure: Earliest and latest UTC of the present in ns, as the node knows it.
    """

    def __init__(
        self,
        outbox: Outbox,
        *,
        own: Identity,
        cloud: str,
        controls: TypedControls,
        enclosure: Callable[[], tuple[int, int]],
    ) -> None:
        self._topic = node_topic(own.name, Stream.COMMANDS)
        self._enclosure = enclosure
        self._firmware = commander.Commander(own.name, outbox, _Checked(controls))
        trust = ChainVerifier.following(own.directory / ROOT_FILE, clock=self._now)
        self._started = False
        self._verifier = Verifier(trust, kind=IdentityKind.SERVER, name=cloud)

    def start(self) -> None:
        """Restore the state and report it; once, before any command.

        Raises:
            FlashError: The stored result cannot be read.
        """
        try:
            self._start()
        except FlashError as error:
            log.warning("state not reported yet: error=%s", error)
        except ValueError as error:
            raise FlashError(
                f"the stored result of the last command cannot be read: {error}"
            ) from error

    def report(self) -> None:
        """Store a state that changed by itself, and report it.

        Raises:
            FlashError: It could not be stored.
        """
        if not self._started:
            self._start()
        self._firmware.report(self._enclosure())

    def take(self, signed: bytes) -> None:
        """Execute a command that was sealed to this node.

        Args:
            signed: The COSE_Sign1 inside.

        Raises:
            FlashError: Its result was not stored. It is not answered, so it comes again, and
                then only the result is written.
        """
        if not self._started:
            # Without the stored result it might execute a command twice.
            self._start()
        try:
            plaintext = self._verifier.verify(signed, topic=self._topic)
            done = self._firmware.take(plaintext, self._enclosure())
        except (EnvelopeError, IdentityError, ValueError) as error:
            log.warning("command rejected: reason=%s", error)
            return
        if done is not None:
            number, name, outcome = done
            log.info(
                "command executed: name=%s id=%d outcome=%s",
                name,
                number,
                Outcome(outcome).name.lower(),
            )

    def _start(self) -> None:
        self._started = False
        self._firmware.start(self._enclosure())
        self._started = True

    def _now(self) -> datetime:
        seconds = min(self._enclosure()[1] // SECOND, _MOST_SECONDS)
        return datetime.fromtimestamp(seconds, UTC)


class _Checked:
    """Controls for the firmware: arguments are checked, errors become refusals."""

    __slots__ = ("_controls",)

    def __init__(self, controls: TypedControls) -> None:
        self._controls = controls

    def apply(self, name: str, arguments: dict[str, Any]) -> State:
        """Apply a command, or raise `Refusal`."""
        try:
            if name not in CommandName.__members__.values():
                raise CommandError("command", name, ", ".join(CommandName))
            checked = check_arguments(CommandName(name), arguments)
            return self._controls.apply(name, checked)
        except EskinError as error:
            raise commander.Refusal(printable(error)) from error

    def restore(self, state: Any) -> State:
        """Restore the last reported state."""
        return self._controls.restore(state)

    @property
    def state(self) -> State:
        """The state."""
        return self._controls.state


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
