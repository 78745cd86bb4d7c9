"""What flows while nothing is done: connection events, TLS handshakes, flash at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.interval import Interval

if TYPE_CHECKING:
    from eskin_sensor_node.machine.power.settings import EnergySection

_DAY_S: Final = 86_400


def idle_power(sheet: EnergySection) -> Interval:
    """Power in W of listening, handshakes and flash, as long as the machine has power.

    A connection event with data is counted like one without; there may be no handshake in a day.
    """
    event = Interval.relative(sheet.listening, sheet.listening_tolerance)
    handshake = Interval.relative(sheet.handshake, sheet.handshake_tolerance)
    often = Interval(0.0, sheet.handshakes_a_day)
    resting = Interval.relative(sheet.flash_resting, sheet.flash_resting_tolerance)
    return event / sheet.connection_interval_s + handshake * often / _DAY_S + resting
