"""Settings of a node: one TOML file; all but ``[[taxel]]`` also comes from the environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from eskin.errors import IdentityError
from eskin.identity import IdentityKind
from eskin.runtime.settings import Host, KeysSection, LogSection, RenewalSection, Section, Settings
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.kinds.registry import Taxel
from eskin_sensor_node.kinds.settings import Companion, TaxelSection
from eskin_sensor_node.machine.data_sheet import coverage
from eskin_sensor_node.machine.power.settings import EnergySection
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.world.scenario.fit import Played


class NodeSection(Section):
    """What the node is."""

    name: str = Field(description="the node's id: common name of its certificate")
    profile: str = Field(
        description="name of its design; without [[taxel]] tables, the packaged profile of that "
        "name (fingertip, palm, forearm, hand, sole, sock) gives them; its [sampling] and [energy] "
        "hold wherever the file says nothing"
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
    """How samples become blocks."""

    block_samples: int = Field(default=250, ge=1, le=1000, description="samples in a block")
    watched_block_ms: float = Field(
        default=50.0,
        ge=0,
        le=10_000,
        description="a block's length while somebody looks at the node, if its own is longer; 0: "
        "never shorter",
    )
    encoding: Literal["f64", "f32", "q16"] = Field(
        default="q16", description="how a block writes its bounds: f64, f32 or q16"
    )
    overrun_s: float = Field(
        default=1.0, gt=0, description="real seconds behind after which samples count as lost"
    )


class FleetSection(Section):
    """Many nodes of one design in one process."""

    count: int = Field(
        default=0,
        ge=0,
        le=100_000,
        description="how many nodes, called NAME-0001 and so on, with `node.name` for NAME; 0: one "
        "node, called as `node.name` says",
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
        default=3.0, ge=0, description="seconds to wait for acknowledgements when told to end"
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
        description="how often a packet is sent until the radio gives its message up, which the "
        "node then sends again after resend_s",
    )


class IdentitySection(Section):
    """Who the node is, and to which site it seals."""

    directory: Path = Field(
        description="folder with key.pem, chain.pem and root.pem; of a fleet, a folder with such a "
        "folder for each node, of its name"
    )
    site: Path = Field(description="PEM file of the site's certificate")
    cloud: str = Field(
        default="server.cloud",
        pattern=r"^server\.[a-z0-9][a-z0-9_-]{0,62}$",
        description="common name of the server whose commands are obeyed",
    )


class FlashSection(Section):
    """Where messages wait for their acknowledgement."""

    path: Path = Field(description="database file")
    capacity_bytes: int = Field(
        default=64 * 2**20, ge=2**16, description="bytes of messages that it may hold"
    )


class ChipKeysSection(KeysSection):
    """Where the key of the flash is; without a folder, in `keys` beside the flash."""


class TruthSection(Section):
    """What the emulator knows and the node does not, for the audit."""

    path: Path = Field(description="database file")
    limit_bytes: int = Field(
        default=256 * 2**20, ge=2**16, description="bytes of samples; the oldest give way"
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
    """The emulated microcontroller; by default as an STM32U575 (ST, DS13737)."""

    clock_hz: int = Field(
        default=160_000_000,
        ge=10**6,
        le=10**10,
        description="cycles of its Cortex-M33 a second; a node that needs more is refused",
    )
    ram_bytes: int = Field(
        default=784 * 1024,
        ge=2**10,
        description="bytes of its RAM; a node that needs more is refused",
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
        description="emulated seconds without a sign of life after which the watchdog resets it",
    )


class NodeRenewalSection(RenewalSection):
    """As everywhere, but seldom: there may be many nodes."""

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
    taxel: tuple[Taxel, ...] = Field(
        min_length=1,
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
        filled = {"taxel": profile.taxels} | data
        for name, section in profile.sections.items():
            given = data.get(name, {})
            if isinstance(given, dict):
                filled[name] = section | given
        if not node.get("description"):
            filled["node"] = node | {"description": profile.description}
        return filled

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
                    raise ValueError(f"{taxel.id} and its {role} '{name}' live other scenarios")
        return value

    def companions(self, taxel: TaxelSection, seed: int) -> dict[str, Companion]:
        """What a taxel reads along, by the names of its inputs; ``seed`` draws all true parts."""
        numbers = {each.id: number for number, each in enumerate(self.taxel)}
        return {
            role: Companion(self.taxel[numbers[name]], (seed, numbers[name]))
            for role, name in taxel.companions.items()
        }

    def coverages(self) -> list[float]:
        """Of each taxel, the probability that a sample's interval holds the truth, at least."""
        each = [(taxel, self.companions(taxel, 0)) for taxel in self.taxel]
        found = patches(self.taxel)
        return [
            coverage(*own, [each[k] for k in found[number].around] if number in found else ())
            for number, own in enumerate(each)
        ]
