"""Records what a node's firmware is given, so that another port can be given the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from eskin_sensor_node.firmware.assembler import Assembler
from eskin_sensor_node.firmware.clock import Clock
from eskin_sensor_node.firmware.commander import Commander
from eskin_sensor_node.firmware.control_unit import ControlUnit
from eskin_sensor_node.firmware.energy import EnergyManager
from eskin_sensor_node.firmware.message_writer import MessageWriter
from eskin_sensor_node.firmware.selftest import SelfTest
from eskin_sensor_node.firmware.taxel.taxel import Taxel

from tests.unit.sensor_node.firmware.answers import Answers
from tests.unit.sensor_node.firmware.notation import hexadecimal, hexadecimals, text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pytest
    from eskin_sensor_node.firmware.autoranging import Hold, Readings
    from eskin_sensor_node.firmware.channel import ChannelUnit
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.firmware.schedule import Frame

    from eskin.wire.messages.command import State

T = TypeVar("T")
_SCHEDULE = ("dt", "stretch", "most", "burst", "pause")
_PATCH = ("number", "page", "columns", "finest", "subject", "epoch")


class Recorder:
    """Stands between a machine and its firmware, and writes down what the firmware gets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.job: dict[str, Any] = {"boot": 1, "taxels": [], "steps": []}
        self._units: list[ControlUnit] = []
        self._calling = self._deciding = False
        self._answers: list[Any] = []
        self._again: dict[int, list[tuple[int, int, int, list[Any]]]] = {}
        # By taxel: one that is read along is made within another one.
        self._sheets: dict[Taxel, tuple[type[Taxel], Mapping[str, float]]] = {}
        self._watch_making(monkeypatch)
        self._watch_assembling(monkeypatch)
        self._watch_working(monkeypatch)
        self._watch_telling(monkeypatch)
        self._watch_answers(monkeypatch)
        self._watch_supply(monkeypatch)
        self._watch_self_test(monkeypatch)

    def _watch_making(self, monkeypatch: pytest.MonkeyPatch) -> None:
        make_clock, make_taxel, make_unit = Clock.__init__, Taxel.__init__, ControlUnit.__init__

        def clock(made: Clock, reading: int, error: int, drift: int) -> None:
            self.job |= {"reading": str(reading), "error": error, "drift": drift}
            make_clock(made, reading, error, drift)

        def taxel(made: Taxel, sheet: Mapping[str, float], *rest: Any) -> None:
            self._sheets[made] = (type(made), sheet)
            make_taxel(made, sheet, *rest)

        def unit(made: ControlUnit, name: str, calibrated: Taxel, **given: Any) -> None:
            self._units.append(made)
            self.job["taxels"].append(self._described(name, calibrated, given))
            make_unit(made, name, calibrated, **given)

        monkeypatch.setattr(Clock, "__init__", clock)
        monkeypatch.setattr(Taxel, "__init__", taxel)
        monkeypatch.setattr(ControlUnit, "__init__", unit)

    def _watch_assembling(self, monkeypatch: pytest.MonkeyPatch) -> None:
        make, flush = Assembler.__init__, Assembler.flush

        def assembler(
            made: Assembler, clock: Clock, message_writer: MessageWriter, *rest: Any
        ) -> None:
            self.job["layout"] = message_writer._layout.hex()
            make(made, clock, message_writer, *rest)

        def flushed(assembler: Assembler) -> list[Record]:
            self.job["steps"].append({"flush": True})
            return flush(assembler)

        monkeypatch.setattr(Assembler, "__init__", assembler)
        monkeypatch.setattr(Assembler, "flush", flushed)

    def _watch_working(self, monkeypatch: pytest.MonkeyPatch) -> None:
        measure, skip, separate = ControlUnit.measure, ControlUnit.skip, ControlUnit.separate
        tell, surround = ControlUnit.report, ControlUnit.surround

        def measured(
            unit: ControlUnit, frame: Frame, readings: Readings, other: Readings | None = None
        ) -> None:
            taken = [readings] if other is None else [readings, other]
            given = [self._described_readings(each) for each in taken]
            numbers = frame.first, frame.start, frame.trigger, frame.n, frame.dt, frame.due
            described = [*map(str, numbers), frame.closes]
            self._note(unit, frame=described, codes=given)
            measure(unit, frame, *taken)

        def separated(unit: ControlUnit) -> None:
            self._note(unit, separate=True)
            separate(unit)

        def stated(unit: ControlUnit) -> list[ChannelUnit]:
            self._note(unit, tell=True, broken=unit.broken)
            return tell(unit)

        def surrounded(unit: ControlUnit, around: Sequence[ControlUnit], neighbours: int) -> None:
            self._note(unit, around=[self._units.index(each) for each in around], of=neighbours)
            surround(unit, around, neighbours)

        def skipped(unit: ControlUnit, samples: int) -> None:
            if not self._calling:
                self._note(unit, skip=samples)
            skip(unit, samples)

        self._watch_repeating(monkeypatch)
        monkeypatch.setattr(ControlUnit, "measure", measured)
        monkeypatch.setattr(ControlUnit, "separate", separated)
        monkeypatch.setattr(ControlUnit, "report", stated)
        monkeypatch.setattr(ControlUnit, "surround", surrounded)
        monkeypatch.setattr(ControlUnit, "skip", skipped)
        for name in ("calibrate", "amplify", "adapt", "smooth", "set_threshold", "sample_every"):
            self._watch_setting(monkeypatch, name)

    def _watch_repeating(self, monkeypatch: pytest.MonkeyPatch) -> None:
        repeat = ControlUnit.repeat

        def repeated(unit: ControlUnit, readings: Readings, i: int, k: int, hold: Hold) -> None:
            first, answers = readings.codes[i][k], []

            def held(gain: float, trim: int) -> int:
                answers.append([[hexadecimal(gain), trim], code := hold(gain, trim)])
                return code

            repeat(unit, readings, i, k, held)
            self._again.setdefault(id(readings), []).append((i, k, first, answers))

        monkeypatch.setattr(ControlUnit, "repeat", repeated)

    def _watch_telling(self, monkeypatch: pytest.MonkeyPatch) -> None:
        gap, status = MessageWriter.gap, MessageWriter.status

        def stated_gap(  # noqa: PLR0917 - as it is called
            message_writer: MessageWriter,
            reason: int,
            time: tuple[int, int],
            samples: int,
            messages: int = 0,
            lost: Sequence[tuple[int, int, int]] = (),
            sequence: int | None = None,
            taxel: str = "",
            patches: Sequence[int] = (),
        ) -> Record:
            instant = [str(each) for each in time]
            step = {"gap": reason, "broken": taxel, "time": instant, "samples": samples}
            self.job["steps"].append(step | {"patches": list(patches)})
            rest = messages, lost, sequence, taxel, patches
            return gap(message_writer, reason, time, samples, *rest)

        def stated_status(
            message_writer: MessageWriter,
            time: tuple[int, int],
            profile: str,
            description: str,
            uptime: int,
            storage: tuple[int, int, int, int],
            cause: int,
            **more: Any,
        ) -> Record:
            given: dict[str, Any] = {"status": profile, "description": description}
            given |= {"storage": storage, "cause": cause, "lives": more.get("energy") is not None}
            given["faults"] = more.get("faults")
            given["held"], given["ended"] = more.get("held"), more.get("ended")
            given["heard"] = (
                None if message_writer.gateway_time is None else str(message_writer.gateway_time)
            )
            instant = {"time": [str(each) for each in time], "uptime": str(uptime)}
            self.job["steps"].append(given | instant)
            stated = time, profile, description, uptime, storage, cause
            return status(message_writer, *stated, **more)

        monkeypatch.setattr(MessageWriter, "gap", stated_gap)
        monkeypatch.setattr(MessageWriter, "status", stated_status)

    def _watch_answers(self, monkeypatch: pytest.MonkeyPatch) -> None:
        result = MessageWriter.result

        def stated_result(
            message_writer: MessageWriter,
            time: tuple[int, int],
            command: int,
            outcome: int,
            reason: str | None,
            state: State,
        ) -> Record:
            assert self._deciding, "only the firmware says what became of a command"
            return result(message_writer, time, command, outcome, reason, state)

        monkeypatch.setattr(MessageWriter, "result", stated_result)
        make, start, take = Commander.__init__, Commander.start, Commander.take

        def made(commander: Commander, node: str, outbox: Outbox, controls: Any) -> None:
            self.job["node"] = node
            make(commander, node, outbox, Answers(controls, self._answers))

        def started(commander: Commander, time: tuple[int, int]) -> None:
            kept = commander._outbox.answer()
            self._decide(lambda: start(commander, time), time, start=kept and kept.hex())

        def taken(
            commander: Commander, plaintext: bytes, time: tuple[int, int]
        ) -> tuple[int, str, int] | None:
            return self._decide(
                lambda: take(commander, plaintext, time), time, take=plaintext.hex()
            )

        monkeypatch.setattr(Commander, "__init__", made)
        monkeypatch.setattr(Commander, "start", started)
        monkeypatch.setattr(Commander, "take", taken)

    def _decide(self, act: Callable[[], T], time: tuple[int, int], **step: Any) -> T:
        self._deciding = True
        self._answers.clear()
        try:
            return act()
        finally:
            self._deciding = False
            instant = [str(each) for each in time]
            self.job["steps"].append({**step, "time": instant, "answers": list(self._answers)})

    def _watch_supply(self, monkeypatch: pytest.MonkeyPatch) -> None:
        make, watch = EnergyManager.__init__, EnergyManager.watch

        def made(manager: EnergyManager, sheet: Mapping[str, float]) -> None:
            self.job["energy"] = hexadecimals(sheet)
            make(manager, sheet)

        def watched(manager: EnergyManager, code: int, work: Sequence[int]) -> None:
            self.job["steps"].append({"supply": code, "work": [str(each) for each in work]})
            watch(manager, code, work)

        rest, recall = EnergyManager.rest, EnergyManager.recall

        def rested(manager: EnergyManager, time: tuple[int, int]) -> bytes:
            self.job["steps"].append({"rest": [str(each) for each in time]})
            return rest(manager, time)

        def recalled(manager: EnergyManager, record: bytes, time: tuple[int, int]) -> None:
            instant = [str(each) for each in time]
            self.job["steps"].append({"recall": record.hex(), "time": instant})
            recall(manager, record, time)

        monkeypatch.setattr(EnergyManager, "rest", rested)
        monkeypatch.setattr(EnergyManager, "recall", recalled)
        monkeypatch.setattr(EnergyManager, "__init__", made)
        monkeypatch.setattr(EnergyManager, "watch", watched)

    def _watch_self_test(self, monkeypatch: pytest.MonkeyPatch) -> None:
        make, take, examine = SelfTest.__init__, SelfTest.take, SelfTest.examine

        def made(test: SelfTest, neighbours: Sequence[Sequence[int]]) -> None:
            self.job["neighbours"] = neighbours
            make(test, neighbours)

        def taken(
            test: SelfTest, taxel: int, lows: Sequence[float], highs: Sequence[float], n: int
        ) -> None:
            # The other port shows its own bounds of that taxel.
            assert lows is self._units[taxel].units[0].lows
            self.job["steps"].append({"show": taxel})
            take(test, taxel, lows, highs, n)

        def examined(test: SelfTest) -> list[tuple[int, int]]:
            found = examine(test)
            self.job["steps"].append({"examine": [list(each) for each in found]})
            return found

        monkeypatch.setattr(SelfTest, "__init__", made)
        monkeypatch.setattr(SelfTest, "take", taken)
        monkeypatch.setattr(SelfTest, "examine", examined)

    def _watch_setting(self, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        method = getattr(ControlUnit, name)

        def called(unit: ControlUnit, *given: float) -> object:
            texts = [text(value) for value in given]
            self._note(unit, call=name, given=texts, reals=[type(v) is float for v in given])
            self._calling = True
            answer = method(unit, *given)
            self._calling = False
            return answer

        monkeypatch.setattr(ControlUnit, name, called)

    def _note(self, unit: ControlUnit, **step: Any) -> None:
        self.job["steps"].append({"taxel": self._units.index(unit), **step})

    def _described_readings(self, readings: Readings) -> dict[str, Any]:
        """The codes as they came, and what was converted again."""
        first = [list(each) for each in readings.codes]
        again = self._again.pop(id(readings), [])
        for i, k, code, _ in again:
            first[i][k] = code
        asked = [[i, k, answers] for i, k, _, answers in again]
        return {"first": first, "ranges": len(readings.ranges), "again": asked}

    def _described(self, name: str, made: Taxel, given: dict[str, Any]) -> dict[str, Any]:
        kind, sheet = self._sheets[made]
        schedule = given["schedule"]
        return {
            "id": name,
            "module": kind.__module__,
            "class": kind.__name__,
            "sheet": hexadecimals(sheet),
            "schedule": [getattr(schedule, name) for name in _SCHEDULE],
            "coverage": hexadecimal(given["coverage"]),
            "prominences": hexadecimals(given["prominences"]),
            "longest": str(given["longest"]),
            "columns": [
                [[getattr(patch, name) for name in _PATCH], column]
                for patch, column in given["columns"]
            ],
            "repeats": given["repeats"],
        }
