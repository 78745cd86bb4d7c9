"""Under which conditions a budget's verdict holds: what no data sheet of a part tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin_sensor_node.settings import NodeSettings


def conditions(settings: NodeSettings) -> list[str]:
    """Each as a sentence's end, with the settings that state it."""
    energy, often = settings.energy, f"{settings.energy.connection_interval_s:g} s"
    return [
        "every part lies inside the tolerances of [energy]",
        f"at most {energy.packet_loss:.0%} of all packets are lost and sent again (packet_loss)",
        f"a Bluetooth connection has an event every {often} (connection_interval_s)",
        f"there are at most {energy.handshakes_a_day:g} TLS handshakes a day (handshakes_a_day)",
        "flash is written once a message, erased as often as written, and powered down between",
        "the firmware is compiled, and takes the cycles that docs/node.md counts and assumes",
        "touches come as in the scenario that was run",
    ]
