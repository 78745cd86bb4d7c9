"""Lets the firmware cut blocks for somebody who looks on; runs under CPython and MicroPython."""

from eskin_sensor_node.firmware.schedule import Attention, Schedule

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any


def cut(job: "Mapping[str, Any]") -> "list[Any]":
    """Give the frames of a schedule, while looks of some ns begin at some frames.

    ``cut`` holds the schedule's arguments, ``length`` the ns of a block that is looked at,
    ``looks`` for each frame the ns of a look that begins before it, or 0.
    """
    schedule, attention = Schedule(*job["cut"]), Attention(job["length"])
    frame = schedule.frame(0)
    told = []
    for look in job["looks"]:
        told.append([frame.number, frame.first, frame.start, frame.n, frame.closes])
        if look:
            attention.hold(frame.end, int(look))
        frame = schedule.following(frame, attention.most(frame.end, schedule.dt))
    return told
