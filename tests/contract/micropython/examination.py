"""Lets the firmware's self-test see tubes; runs under CPython and MicroPython alike."""

import struct

from eskin_sensor_node.firmware.selftest import BoundsWindow, SelfTest

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any


def examine(job: "Mapping[str, Any]") -> "list[Any]":
    """Give what each taxel's window knows of its samples, and what the self-test finds.

    ``tubes`` holds for each taxel its windows, one after the other, each as pairs of bounds in
    hexadecimal; ``neighbours`` holds the numbers of those around it.
    """
    test = SelfTest(job["neighbours"])
    stated: list[Any] = []
    for k in range(len(job["tubes"][0])):
        for number, tubes in enumerate(job["tubes"]):
            lows, highs = [_real(pair[:16]) for pair in tubes[k]], [_real(p[16:]) for p in tubes[k]]
            test.take(number, lows, highs, len(lows))
            stated.append(_seen(lows, highs))
        stated.append([list(found) for found in test.examine()])
    return stated


def _seen(lows: "Sequence[float]", highs: "Sequence[float]") -> "list[Any]":
    window = BoundsWindow()
    window.take(lows, highs, len(lows))
    bounds = struct.pack("<3d", window.moved[0], window.moved[1], window.width).hex()
    return [bounds, window.dead, window.still, window.lively]


def _real(text: str) -> float:
    value: float
    (value,) = struct.unpack("<d", bytes.fromhex(text))
    return value
