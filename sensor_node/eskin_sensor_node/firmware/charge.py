"""The charge that the firmware stores at shutdown: an interval that time widens.

Left alone, a supercapacitor of capacitance C with a leakage resistance R keeps the share
``exp(-2t/(R·C))`` of its energy. Touches may go on meanwhile, so from above only its rated voltage
bounds what it holds.
"""

import struct

from eskin_sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.calibration import Bounds

_LAYOUT = "<dq"
_HALVINGS = 10
_BILLION = 1000000000


def write_charge(stored: float, earliest: int) -> bytes:
    """A record for flash: J that are stored at least, at an instant not before so many ns UTC."""
    return struct.pack(_LAYOUT, stored, earliest)


def read_charge(record: bytes, latest: int, *, leakage: "Bounds", half: "Bounds") -> float:
    """J that are stored at least, at an instant not after so many ns UTC.

    Args:
        record: As `write_charge` wrote it, when the firmware stopped.
        latest: ns UTC.
        leakage: Bounds of the leakage resistance in ohm.
        half: Bounds of half the capacitance in F.
    """
    stored, earliest = struct.unpack(_LAYOUT, record)
    away = up(max(0, latest - earliest) / _BILLION)
    exponent = up(away / down(leakage[0] * half[0]))
    # exp(-x) >= (1 - x/n)^n for x <= n.
    share = max(0.0, down(1.0 - up(exponent / (1 << _HALVINGS))))
    for _ in range(_HALVINGS):
        share = max(0.0, down(share * share))
    return max(0.0, down(stored * share))
