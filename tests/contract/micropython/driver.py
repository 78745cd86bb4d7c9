"""Lets the firmware work off a recorded job; runs under CPython and MicroPython alike.

A job is JSON in which every float is the hexadecimal form of its eight bytes, so that no port has
to parse a decimal, and every great integer is a text.
"""

import struct
from array import array

from eskin_sensor_node.firmware.assembler import Assembler, Patch
from eskin_sensor_node.firmware.autoranging import Readings
from eskin_sensor_node.firmware.clock import Clock
from eskin_sensor_node.firmware.commander import Commander, Refusal
from eskin_sensor_node.firmware.control_unit import ControlUnit
from eskin_sensor_node.firmware.energy import EnergyManager
from eskin_sensor_node.firmware.message_writer import MessageWriter
from eskin_sensor_node.firmware.schedule import Frame, Schedule
from eskin_sensor_node.firmware.selftest import SelfTest

from tests.contract.micropython.delivery import deliver
from tests.contract.micropython.examination import examine
from tests.contract.micropython.monitoring import decide as run_monitors
from tests.contract.micropython.sampling import encode

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any, Self

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.taxel.taxel import Taxel

    Table = Mapping[str, Any]


class Counter:
    """Counts messages."""

    def __init__(self) -> None:
        self.next = 0

    def next_sequence(self) -> int:
        """The next number."""
        self.next += 1
        return self.next - 1


class Box:
    """What a commander has around it: an outbox that keeps a batch, and settings that answer."""

    def __init__(self, message_writer: MessageWriter) -> None:
        self.message_writer = message_writer
        self.kept: bytes | None = None
        self.records: list[Record] = []
        self.answers: list[Any] = []

    def answer(self) -> "bytes | None":
        return self.kept

    def batch(self) -> "Box":
        return self

    def __enter__(self) -> "Self":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is kept on a chip here."""

    def take(self, records: "Sequence[Record]") -> None:
        self.records += records

    def restore(self, state: "Table") -> "dict[str, Any]":
        return self.apply("restore", state)

    def apply(self, name: str, arguments: "Table") -> "dict[str, Any]":
        """Answer as it was answered before; else this is another question."""
        answer = self.answers.pop(0)
        asked, given = answer["asked"]
        wanted = state({"state": given})
        assert name == asked
        assert arguments == (wanted if name == "restore" else wanted.get("", {}))
        if "refusal" in answer:
            raise Refusal(answer["refusal"])
        return state(answer)


def decide(step: "Table", commander: Commander, box: Box) -> "list[Record]":
    """Start, or take a command; gives what is said of it."""
    box.records, box.answers = [], list(step["answers"])
    if "start" in step:
        box.kept = step["start"] and bytes.fromhex(step["start"])
        commander.start(times(step))
    else:
        try:
            commander.take(bytes.fromhex(step["take"]), times(step))
        except ValueError:
            assert not box.records
    assert not box.answers
    return box.records


def real(text: str) -> float:
    value: float
    (value,) = struct.unpack("<d", bytes.fromhex(text))
    return value


def reals(table: "Table") -> "dict[str, float]":
    return {name: real(text) for name, text in table.items()}


def firmware_class(module: str, name: str) -> "type[Taxel]":
    """What the control unit knows of a kind of taxel."""
    found: type[Taxel] = getattr(__import__(module, None, None, (name,)), name)
    return found


def control_unit(taxel: "Table", clock: Clock, assembler: Assembler) -> ControlUnit:
    return ControlUnit(
        taxel["id"],
        firmware_class(taxel["module"], taxel["class"])(reals(taxel["sheet"])),
        schedule=Schedule(*taxel["schedule"]),
        coverage=real(taxel["coverage"]),
        prominences=reals(taxel["prominences"]),
        longest=int(taxel["longest"]),
        columns=[(Patch(*patch), column) for patch, column in taxel["columns"]],
        repeats=taxel["repeats"],
        clock=clock,
        assembler=assembler,
    )


def run(job: "Table") -> "list[Any]":
    """Do what a job asks."""
    if "tubes" in job:
        return examine(job)
    if "matrices" in job:
        return encode(job)
    if "monitors" in job:
        return run_monitors(job)
    return deliver(job) if "script" in job else say(job)


def say(job: "Table") -> "list[Any]":  # noqa: C901 - a branch a kind of step
    """Give the bytes of every message, in hexadecimal, and then what each self-test found."""
    clock = Clock(int(job["reading"]), job["error"], job["drift"])
    message_writer = MessageWriter(job["boot"], Counter(), bytes.fromhex(job["layout"]))
    assembler = Assembler(clock, message_writer)
    units = [control_unit(taxel, clock, assembler) for taxel in job["taxels"]]
    manager = EnergyManager(reals(job["energy"])) if "energy" in job else None
    box = Box(message_writer) if "node" in job else None
    commander = Commander(job["node"], box, box) if box else None  # type: ignore[arg-type]  # all it needs
    test = SelfTest(job["neighbours"])
    said: list[Record] = []
    found: list[Any] = []
    for step in job["steps"]:
        if "show" in step:
            unit = units[step["show"]].units[0]
            test.take(step["show"], unit.lows, unit.highs, unit.filled)
        elif "examine" in step:
            found.append([list(each) for each in test.examine()])
        elif commander and box and ("take" in step or "start" in step):
            said += decide(step, commander, box)
        elif manager and "rest" in step:
            time = int(step["rest"][0]), int(step["rest"][1])
            found.append(manager.rest(time).hex())
        elif manager and "recall" in step:
            manager.recall(bytes.fromhex(step["recall"]), times(step))
        elif manager and "supply" in step:
            manager.watch(step["supply"], tuple([int(text) for text in step["work"]]))
            for unit in units:
                unit.shed = manager.stage
        elif "flush" in step:
            said += assembler.flush()
        elif "taxel" in step:
            drive(step, units)
        else:
            said.append(tell(step, message_writer, manager))
    return [bytes(record.body).hex() for record in said] + found


def tell(step: "Table", message_writer: MessageWriter, manager: "EnergyManager | None") -> "Record":
    if "gap" in step:
        named = {"taxel": step["broken"], "patches": step["patches"]}
        return message_writer.gap(step["gap"], times(step), step["samples"], **named)
    if "status" in step:
        uptime, storage = int(step["uptime"]), step["storage"]
        stated = (step["status"], step["description"], uptime, storage, step["cause"])
        energy = manager.status if manager and step["lives"] else None
        if step["heard"] is not None:
            message_writer.observe_time(int(step["heard"]))
        more = {"energy": energy, "faults": step["faults"]}
        more["held"], more["ended"] = step["held"], step["ended"]
        return message_writer.status(times(step), *stated, **more)
    raise ValueError("an unknown step")


def drive(step: "Table", units: "Sequence[ControlUnit]") -> None:
    unit = units[step["taxel"]]
    if "call" in step:
        given = zip(step["given"], step["reals"])  # noqa: B905 - MicroPython's zip
        values = [real(text) if is_real else int(text) for text, is_real in given]
        getattr(unit, step["call"])(*values)
    elif "skip" in step:
        unit.skip(step["skip"])
    elif "tell" in step:
        unit.broken = step["broken"]
        unit.report()
    elif "codes" in step:
        taken = [readings(unit, each) for each in step["codes"]]
        *numbers, closes = step["frame"]
        frame = Frame(*[int(number) for number in numbers], closes=closes)
        unit.measure(frame, *taken)
    elif "separate" in step:
        unit.separate()
    else:
        unit.surround([units[k] for k in step["around"]], step["of"])


def readings(unit: ControlUnit, given: "Table") -> Readings:
    """The codes as they came, converted again as the firmware wants it."""
    made = Readings(
        [array("i", each) for each in given["first"]],
        [array("b", bytes(len(given["first"][0]))) for _ in range(given["ranges"])],
    )
    for i, k, answers in given["again"]:
        left = list(answers)

        def hold(gain: float, trim: int, left: "list[Any]" = left) -> int:
            asked, code = left.pop(0)
            assert asked == [struct.pack("<d", gain).hex(), trim]
            return int(code)

        unit.repeat(made, i, k, hold)
        assert not left
    return made


def state(step: "Table") -> "dict[str, dict[str, float | str]]":
    found: dict[str, dict[str, float | str]] = {}
    for place, name, is_real, text in step["state"]:
        found.setdefault(place, {})[name] = real(text) if is_real else text
    return found


def times(step: "Table") -> "tuple[int, int]":
    return int(step["time"][0]), int(step["time"][1])
