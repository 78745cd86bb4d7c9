"""Settings of a node: one TOML file; all but ``[[taxel]]`` also comes from the environment."""

from __future__ import annotations

from itertools import pairwise
from math import log2
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from eskin.errors import IdentityError
from eskin.identity import IdentityKind
from eskin.runtime.settings import Host, KeysSection, LogSection, RenewalSection, Section, Settings
from eskin.wire.messages.command import MOST_FORMULA
from eskin_sensor_node.kinds.registry import Taxel
from eskin_sensor_node.kinds.settings import Companion, TaxelSection
from eskin_sensor_node.kinds.skin_section import SkinSection
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Played, Staged

_LEAST_BITS: Final = 12
"""Of a gesture key's entropy."""
_TOLERANCE = "relative; the true one lies anywhere inside"


def _positive(default: float, description: str) -> float:
    value: float = Field(default=default, gt=0, lt=1e12, description=description)
    return value


def _part(default: float) -> float:
    value: float = Field(default=default, ge=0, lt=0.5, description=_TOLERANCE)
    return value


def _wide(default: float) -> float:
    value: float = Field(default=default, ge=0, lt=1, description=_TOLERANCE)
    return value


class NodeSection(Section):
    """Identity and design of the node."""

    name: str = Field(description="the node's id: common name of its certificate")
    profile: str = Field(
        description="name of its design; without [[taxel]] tables, the packaged profile of that "
        "name (fingertip, palm, forearm, hand, sole, sock, and with a skin paper-hand, small-hand) "
        "gives them; its other sections apply wherever the file has no value"
    )
    description: str = Field(
        default="", max_length=200, description="one line for people; empty: the profile's"
    )
    seed: int | None = Field(
        default=None,
        ge=0,
        lt=2**63,
        description="draws the true parts and the noise; none: random at the first start, then "
        "kept beside the truth",
    )
    speed: float = Field(
        default=1.0, gt=0, le=1000, description="emulated seconds in a real second"
    )

    @field_validator("name")
    @classmethod
    def _a_node(cls, value: str) -> str:
        try:
            return IdentityKind.NODE.require_name(value)
        except IdentityError as error:
            raise ValueError(str(error)) from error


class SamplingSection(Section):
    """Stretches of time."""

    stretch_ms: float = Field(
        default=100.0,
        ge=1,
        le=60_000,
        description="length of a stretch of time: the node writes its samples as frames at its "
        "end, and viewers see them no sooner; 50 where a robot reacts, 1000 and more in fleets and "
        "on batteries",
    )
    overrun_s: float = Field(
        default=1.0, gt=0, description="real seconds behind after which samples count as lost"
    )

    @property
    def stretch(self) -> int:
        """Length of a stretch, ns."""
        return round(self.stretch_ms * 1e6)


class FleetSection(Section):
    """Many nodes of one design in one process."""

    count: int = Field(
        default=0,
        ge=0,
        le=100_000,
        description="how many nodes, called NAME-0001 and so on, with `node.name` for NAME; 0: one "
        "node, called `node.name`",
    )


class BrokerSection(Section):
    """Where the node publishes, over TLS."""

    host: Host = Field(default="127.0.0.1", description="the broker's host")
    port: int = Field(default=8883, ge=1, le=65535, description="the broker's TLS port")
    keepalive_s: int = Field(default=15, ge=1, le=3600, description="MQTT keep-alive in seconds")
    window: int = Field(
        default=200, ge=1, le=10_000, description="messages in flight without acknowledgement"
    )
    resend_s: float = Field(
        default=2.0, gt=0, description="seconds from leaving the radio until it is sent again"
    )
    status_s: float = Field(default=5.0, gt=0, description="seconds between two status messages")
    silence_s: float = Field(
        default=30.0,
        gt=0,
        description="seconds without any acknowledgement, while messages wait for one, after which "
        "the node connects anew; doubled each time, up to 16 times as long",
    )
    drain_s: float = Field(
        default=3.0, ge=0, description="seconds to wait for acknowledgements when stopping"
    )


class RadioSection(Section):
    """The air between the node and its access point, emulated."""

    bandwidth_bytes_per_s: int | None = Field(
        default=None,
        ge=1,
        description="bytes that it carries in an emulated second; none: as fast as the network",
    )
    loss: float = Field(default=0.0, ge=0, lt=1, description="probability that a packet is lost")
    packet_bytes: int = Field(default=1024, ge=16, le=65536, description="bytes in a packet")
    tries: int = Field(
        default=4,
        ge=1,
        le=100,
        description="how often a packet is sent until the radio drops its message, which the "
        "node then sends again after resend_s",
    )


class IdentitySection(Section):
    """The node's identity, and the site to which it seals."""

    directory: Path = Field(
        description="folder with key.pem, chain.pem and root.pem; of a fleet, a folder with such a "
        "folder for each node, of its name"
    )
    site: Path = Field(description="PEM file of the site's certificate")
    cloud: str = Field(
        default="server.cloud",
        pattern=r"^server\.[a-z0-9][a-z0-9_-]{0,62}$",
        description="common name of the server whose commands are accepted",
    )


class FlashSection(Section):
    """Storage of messages until they are acknowledged."""

    path: Path = Field(description="database file")
    capacity_bytes: int = Field(
        default=64 * 2**20, ge=2**16, description="bytes of messages that it may hold"
    )


class ChipKeysSection(KeysSection):
    """Where the key of the flash is; without a folder, in `keys` beside the flash."""


class TruthSection(Section):
    """True values, which only the emulator knows, for the audit."""

    path: Path = Field(description="database file")
    limit_bytes: int = Field(
        default=256 * 2**20, ge=2**16, description="bytes of samples; the oldest are dropped"
    )


class ClockSection(Section):
    """The node's clock."""

    rtc_error_ms: float = Field(
        default=2.0, ge=0, le=3.6e6, description="greatest error of the real-time clock, in ms"
    )
    drift_ppm: float = Field(
        default=20.0, ge=0, le=1e4, description="greatest rate error of the crystal, in 1e-6"
    )


class MachineSection(Section):
    """The emulated machine; by default a microcontroller as an STM32U575 (ST, DS13737)."""

    processor: Literal["cortex-m33", "cortex-a53"] = Field(
        default="cortex-m33",
        description="what a skin's budget takes the cycles of each operation from; a Cortex-A53 "
        "computes binary64 in hardware",
    )
    cores: int = Field(
        default=1, ge=1, le=64, description="that share the work of a skin; other nodes use one"
    )
    clock_hz: int = Field(
        default=160_000_000,
        ge=10**6,
        le=10**10,
        description="cycles of a core a second; a node that needs more does not start",
    )
    ram_bytes: int = Field(
        default=784 * 1024,
        ge=2**10,
        description="bytes of its RAM; a node that needs more does not start",
    )
    flash_bytes: int = Field(
        default=2 * 2**20,
        ge=2**10,
        description="bytes of its own flash, for its program; messages stand on a chip beside it",
    )
    dma_samples: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="samples of a taxel after which an interrupt wakes the processor; 1: each "
        "sample; 0: a whole frame, as by DMA with two buffers",
    )
    watchdog_s: float = Field(
        default=8.0,
        ge=0.01,
        le=3600,
        description="emulated seconds without a kick after which the watchdog resets it",
    )


class EnergySection(Section):
    """A node that runs on a supercapacitor and harvested touches; see docs/energy.md."""

    on: bool = Field(default=False, description="whether the node runs on its supercapacitor")
    horizon_s: float = Field(
        default=20.0, gt=0, le=86_400, description="seconds over which the verdict is given"
    )
    capacitance: float = _positive(0.1, "of the hybrid supercapacitor, F")
    capacitance_tolerance: float = _part(0.1)
    series_resistance: float = _positive(1.0, "of the supercapacitor (ESR), Ω")
    series_resistance_tolerance: float = _part(0.3)
    leakage_resistance: float = _positive(4e6, "of the supercapacitor, Ω")
    leakage_resistance_tolerance: float = _part(0.4)
    start_voltage: float = _positive(3.5, "at the first start, V")
    rated_voltage: float = _positive(3.8, "at which a shunt takes what comes more, V")
    restart_voltage: float = _positive(2.6, "at which a machine that stopped starts again, V")
    brown_out_voltage: float = _positive(2.2, "below which the machine stops, V")
    adc_bits: int = Field(default=12, ge=4, le=24, description="of the supply's converter")
    adc_max: float = _positive(4.0, "end of the supply's converter, V")
    adc_gain_error: float = _part(1e-3)
    adc_offset_error: float = Field(default=1.0, ge=0, le=1000, description="in steps")
    adc_nonlinearity: float = Field(default=0.5, ge=0, le=1000, description="INL, in steps")
    active_current: float = _positive(3e-4, "drawn while the supply is measured, A")
    active_current_tolerance: float = _part(0.3)
    cycle: float = _positive(
        9.6e-11,
        "energy of a cycle of the processor, J: STM32U575's 19.5 µA/MHz at 3.3 V, to twice that",
    )
    cycle_tolerance: float = _part(0.35)
    conversion: float = _positive(
        3e-9,
        "energy of a conversion, J: 3 V times ISAADC0, 1.4 mA at 2 million a second (nRF54L15) to "
        "1.3 mA at 1 million (nRF54LS05A; Nordic, tables of SAADC active)",
    )
    conversion_tolerance: float = _part(0.3)
    sent: float = _positive(
        3e-7,
        "energy of a byte sent, J: nRF52840's 4.8 mA at 3 V for 8 µs, and as much again and more",
    )
    sent_tolerance: float = _part(0.2)
    received: float = _positive(3e-7, "energy of a byte received, J; likewise")
    received_tolerance: float = _part(0.2)
    packet_loss: float = Field(
        default=0.1,
        ge=0,
        le=0.9,
        description="share of packets that is lost and sent again, at most, where a budget counts "
        "each once; a running node counts those of its radio",
    )
    listening: float = _positive(
        1.6e-5,
        "energy of a connection event without data, J: nRF52840's 4.6 to 4.8 mA at 3 V for 0.4 to "
        "1.5 ms (ramp, window, empty packets), and up to 5 µJ for its crystal and processor",
    )
    listening_tolerance: float = _wide(0.67)
    connection_interval_s: float = _positive(
        1.0, "seconds from one connection event to the next, with the events that a node skips"
    )
    handshake: float = _positive(
        1.45e-2,
        "energy of a TLS handshake with certificates on both sides, J: 5 to 200 million cycles "
        "(P-256 in assembly or in plain C; assumed) and 3 to 6 kB on the air",
    )
    handshake_tolerance: float = _wide(0.94)
    handshakes_a_day: float = Field(
        default=4.0, ge=0, le=86_400, description="TLS handshakes, at most; 0: none"
    )
    written: float = _positive(
        1.25e-6,
        "energy of a byte put into flash with its share of an erasure, J: at most 15 mA at 3 V, a "
        "page of 256 bytes in 1.4 to 5 ms, a sector of 4 KiB in 60 to 120 ms (Macronix KH25L8005), "
        "and a third of that current at least",
    )
    written_tolerance: float = _wide(0.77)
    sleeping: float = _positive(
        6.6e-6,
        "power in deep sleep, W: 3 V times 1.5 to 2.9 µA, nRF54L15 with its clock and 64 to 256 kB "
        "of RAM (Nordic, table of sleep, ION_IDLE6 to 8)",
    )
    sleeping_tolerance: float = _part(0.32)
    wake_up: float = _positive(6e-8, "energy of a wake-up from deep sleep, J (assumed)")
    wake_up_tolerance: float = _part(0.2)
    flash_resting: float = _positive(
        3e-6, "power of flash in deep power-down, W: 1 µA at 3 V (Macronix KH25L8005, typical)"
    )
    flash_resting_tolerance: float = _wide(0.7)
    sensor_voltage: float = _positive(0.5, "that the MOSFET switches to the sensor, V")
    sensor_voltage_tolerance: float = _part(0.02)
    pulse_s: float = _positive(1e-3, "for which it is switched on for a conversion, s")
    switch_resistance: float = _positive(1.0, "of the MOSFET that is on, Ω")
    coil_inductance: float = Field(
        default=0.0, ge=0, lt=1e3, description="of MagFES, H; 0: there is no coil"
    )
    coil_resistance: float = _positive(5.0, "of MagFES, Ω")
    sensor_capacitance: float = _positive(1e-9, "of EcFES, F")
    sensor_resistance: float = _positive(1e3, "before EcFES, Ω")
    sensor_tolerance: float = _part(0.1)
    piezo_coefficient: float = _positive(4e-10, "d33 of the piezoelectric layer, C/N")
    piezo_gain: float = _positive(
        10.0, "by which its mount strengthens a force; piezo_tolerance is of d33 with it"
    )
    piezo_capacitance: float = _positive(2e-8, "of a taxel's piezoelectric layer, F")
    piezo_tolerance: float = _part(0.2)
    tribo_charge: float = _positive(3e-5, "surface charge of the triboelectric layer, C/m²")
    tribo_gap_m: float = _positive(1e-3, "to which the layers separate, m")
    tribo_thickness_m: float = _positive(1e-5, "of the layer over its relative permittivity, m")
    tribo_tolerance: float = _part(0.2)
    harvest_efficiency: float = Field(
        default=0.4, gt=0, le=0.66, description="from a layer's charge to the supercapacitor"
    )
    harvest_efficiency_tolerance: float = _part(0.4)

    @model_validator(mode="after")
    def _voltages_rise(self) -> Self:
        if not self.brown_out_voltage < self.restart_voltage < self.rated_voltage <= self.adc_max:
            raise ValueError(
                "brown_out_voltage < restart_voltage < rated_voltage <= adc_max must hold, not "
                f"{self.brown_out_voltage} < {self.restart_voltage} < {self.rated_voltage} <= "
                f"{self.adc_max}"
            )
        if self.start_voltage > self.rated_voltage:
            raise ValueError(f"start_voltage = {self.start_voltage} is above rated_voltage")
        return self


class MonitorSection(Section):
    """A formula that the node evaluates at each sample; see docs/monitors.md."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,30}$", description="the monitor's name")
    formula: str = Field(
        min_length=1,
        max_length=MOST_FORMULA,
        description="over channels such as t01.capacitance, with windows over the past",
    )
    on: Literal["possible", "certain"] = Field(
        default="possible", description="the least verdict with which the output is on"
    )
    output: Literal["none", "stop", "out1", "out2", "out3"] = Field(
        default="none", description="what the machine drives"
    )


class GestureKeySection(Section):
    """A sequence of gestures that lets the node sign a challenge; see docs/gesture-key.md."""

    gestures: tuple[str, ...] = Field(
        default=(),
        max_length=16,
        description="names of the monitors that can be entered; empty: the node has no such key",
    )
    sequence: tuple[str, ...] = Field(
        default=(),
        max_length=7,
        description="those that unlock, in order; none follows itself",
    )
    timeout_s: float = Field(
        default=30.0, gt=0, le=3600, description="seconds for an entry, from the challenge on"
    )
    attempts: int = Field(
        default=5, ge=1, le=100, description="wrong entries in a row after which it locks"
    )
    lockout_s: float = Field(
        default=600.0,
        ge=1,
        le=31_536_000,
        description="seconds for which it is locked then, and after each further one",
    )

    @property
    def entropy(self) -> float:
        """Bits of a sequence that is drawn at random."""
        k, n = len(self.gestures), len(self.sequence)
        return log2(k) + (n - 1) * log2(k - 1) if k > 1 and n else 0.0

    @model_validator(mode="after")
    def _can_be_entered(self) -> Self:
        if len(set(self.gestures)) < len(self.gestures):
            raise ValueError("gestures names a monitor twice")
        unknown = sorted(set(self.sequence) - set(self.gestures))
        if unknown:
            raise ValueError(f"sequence has {', '.join(unknown)}, which gestures does not name")
        if any(first == second for first, second in pairwise(self.sequence)):
            raise ValueError("a gesture of the sequence follows itself; put another one between")
        if self.gestures and self.entropy < _LEAST_BITS:
            raise ValueError(
                f"{len(self.sequence)} of {len(self.gestures)} gestures have {self.entropy:.1f} "
                f"bits, and {_LEAST_BITS} are needed; use a longer sequence or more gestures"
            )
        return self


class NodeRenewalSection(RenewalSection):
    """As in every tier, but less often: there may be many nodes."""

    every_s: float = Field(
        default=60.0, gt=0, le=86_400, description="seconds between two looks at the CA service"
    )


class NodeSettings(Settings):
    """All settings of a node."""

    node: NodeSection
    fleet: FleetSection = FleetSection()
    sampling: SamplingSection = SamplingSection()
    broker: BrokerSection = BrokerSection()
    radio: RadioSection = RadioSection()
    identity: IdentitySection
    flash: FlashSection
    keys: ChipKeysSection = ChipKeysSection()
    truth: TruthSection
    clock: ClockSection = ClockSection()
    machine: MachineSection = MachineSection()
    energy: EnergySection = EnergySection()
    renewal: NodeRenewalSection = NodeRenewalSection()
    log: LogSection = LogSection()
    skin: SkinSection = SkinSection()
    gesture_key: GestureKeySection = GestureKeySection()
    monitor: tuple[MonitorSection, ...] = Field(
        default=(), max_length=16, description="the monitors; a command adds and removes others"
    )
    taxel: tuple[Taxel, ...] = Field(
        default=(),
        max_length=100,
        description="the sensing elements; without them the packaged profile's",
    )

    @property
    def chip_keys(self) -> Path:
        """Folder of the key store."""
        return self.keys.directory or self.flash.path.with_name("keys")

    @model_validator(mode="before")
    @classmethod
    def _take_profile(cls, data: Any) -> Any:
        """Fill in what the file leaves to a packaged profile."""
        node = data.get("node") if isinstance(data, dict) else None
        if not isinstance(node, dict) or node.get("profile") not in profile_names():
            return data
        profile = Profile.read(node["profile"])
        skin = data.get("skin")
        own_skin = isinstance(skin, dict) and skin.get("scenario")
        filled = {"taxel": [] if own_skin else profile.taxels} | data
        for name, section in profile.sections.items():
            if name == "skin" and data.get("taxel"):
                continue
            given = data.get(name, {})
            if isinstance(given, dict):
                filled[name] = section | given
        if not node.get("description"):
            filled["node"] = node | {"description": profile.description}
        return filled

    @model_validator(mode="after")
    def _skin_or_taxels(self) -> Self:
        if self.skin.present == bool(self.taxel):
            raise ValueError("give either [[taxel]] tables or a [skin] with its scenario")
        if self.skin.present and self.fleet.count:
            raise ValueError("a fleet's nodes have [[taxel]] tables; a skin is one node's")
        key = self.gesture_key.gestures
        if key and self.fleet.count:
            raise ValueError("[gesture_key] is of a single node, not of a fleet")
        for name in sorted(set(key) - {each.name for each in self.monitor}):
            raise ValueError(f"gesture_key.gestures names {name}; give it as a [[monitor]]")
        names = self.skin.controllers
        if names and self.node.name not in names:
            raise ValueError(f"skin.controllers = {names} does not name '{self.node.name}'")
        return self

    @field_validator("taxel")
    @classmethod
    def _ids_are_unique(cls, value: tuple[Taxel, ...]) -> tuple[Taxel, ...]:
        ids = [taxel.id for taxel in value]
        twice = sorted({name for name in ids if ids.count(name) > 1})
        if twice:
            raise ValueError(f"the same id twice: {', '.join(twice)}")
        return value

    @field_validator("taxel")
    @classmethod
    def _companions_are_there(cls, value: tuple[Taxel, ...]) -> tuple[Taxel, ...]:
        found = {taxel.id: taxel for taxel in value}
        for taxel in value:
            for role, name in taxel.companions.items():
                if name not in found or found[name].kind != role:
                    raise ValueError(f"{taxel.id}.{role} = '{name}': there is no such {role}")
                both = (taxel, found[name])
                if len({each.scenario for each in both if isinstance(each, Played)}) > 1:
                    raise ValueError(f"{taxel.id} and its {role} '{name}' play different scenarios")
        return value

    @property
    def departures(self) -> list[str]:
        """Which of its taxels the scenarios take out of their data sheets, why and when."""
        if self.skin.present:
            return [str(each) for each in read_scenario(self.skin.scenario).departures]
        return [
            f"{taxel.id} at {each}" if each.taxel else f"{taxel.id}: {each}"
            for taxel in self.taxel
            if isinstance(taxel, Staged)
            for each in read_scenario(taxel.scenario).departures
            if each.taxel in {"", taxel.place} and (taxel.pressed or each.kind in {"stuck", "dead"})
        ]

    def companions(self, taxel: TaxelSection) -> dict[str, Companion]:
        """What a taxel reads along, by the names of its inputs."""
        numbers = {each.id: number for number, each in enumerate(self.taxel)}
        return {
            role: Companion(self.taxel[numbers[name]], numbers[name])
            for role, name in taxel.companions.items()
        }
