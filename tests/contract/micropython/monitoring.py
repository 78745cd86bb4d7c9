"""Lets the firmware run monitors; runs under CPython and MicroPython alike."""

import struct

from eskin_sensor_node.firmware import expression
from eskin_sensor_node.firmware.monitor import CERTAIN, Monitor, Source, Threshold
from eskin_sensor_node.firmware.reflex import Reflex

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from eskin_sensor_node.firmware.expression import Expression


def decide(job: "Mapping[str, Any]") -> "list[Any]":
    """Give verdict and reasons of each monitor at each sample, and the verdict of each comparison.

    ``monitors`` holds for each one its instructions, for each atom four codes and a period, reach,
    drift, period of the steps, and codes of each step; numbers beyond 31 bits are texts.
    ``comparisons`` holds for each one bounds in hexadecimal, and whether 0 is not enough.
    """
    decided: list[Any] = [_run(*each) for each in job["monitors"]]
    for bounds, strict in job["comparisons"]:
        source = Source(1, 0)
        source.take(0, ())
        atom = expression.Comparison([source], _built(bounds), strict=strict, derived=False)
        atom.take(0)
        decided.append([atom.compare(), _hexadecimal(_built(bounds)())])
    return decided


def _run(
    lines: "Sequence[Sequence[Any]]",
    atoms: "Sequence[Sequence[int]]",
    reach: str,
    drift: int,
    dt: str,
    steps: "Sequence[Sequence[int]]",
) -> "list[list[int]]":
    made = []
    for first, last, low, high, period in atoms:
        atom = Threshold(Source(period, drift), 0, derived=False)
        atom.set((first, last), (low, high))
        made.append(atom)
    program = [(op, taken, int(a), int(b), number) for op, taken, a, b, number in lines]
    monitor = Monitor(program, made, int(reach), drift)
    reflex = Reflex("", monitor, CERTAIN, "", 1.0)
    found = []
    for k, codes in enumerate(steps):
        now = k * int(dt)
        for atom, code in zip(made, codes):  # noqa: B905 - MicroPython's zip
            atom.sources[0].fresh = False
            if code >= 0:
                atom.sources[0].take(now, [[code]])
        if reflex.compare(now):
            found.append([monitor.step(now), monitor.because])
    return found


def _built(bounds: "Sequence[str]") -> "Expression":
    """``max(abs(x - y), -z * w)`` of four intervals, the last one around a number not 0."""
    numbers = [struct.unpack("<d", bytes.fromhex(text))[0] for text in bounds]
    x, y, z = [expression.number(*numbers[k : k + 2]) for k in (0, 2, 4)]
    return expression.extreme(
        [
            expression.absolute(expression.total(x, expression.negated(y))),
            expression.product(expression.negated(z), *numbers[6:]),
        ],
        least=False,
    )


def _hexadecimal(bounds: "tuple[float, float]") -> str:
    return struct.pack("<2d", *bounds).hex()
