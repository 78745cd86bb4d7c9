"""Settings of a node: one TOML file; all but ``[[taxel]]`` also comes from the environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from eskin.errors import IdentityError
from eskin.identity import IdentityKind
from eskin.settings import RenewalSection, Section, Settings
from sensor_node.profile import Profile, profile_names
from sensor_node.taxels import Taxel


class NodeSection(Section):
    """What the node is."""

    name: str = Field(description="the node's id: common name of its certificate")
    profile: str = Field(
        description="name of its design; without [[taxel]] tables, the packaged profile of that "
        "name (fingertip, palm, forearm, hand) gives them"
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
    encoding: Literal["f64", "f32", "q16"] = Field(
        default="q16", description="how a block writes its bounds: f64, f32 or q16"
    )
    overrun_s: float = Field(
        default=1.0, gt=0, description="real seconds behind after which samples count as lost"
    )


class BrokerSection(Section):
    """Where the node publishes, over TLS."""

    host: str = Field(default="127.0.0.1", description="the broker's host")
    port: int = Field(default=8883, ge=1, le=65535, description="the broker's TLS port")
    keepalive_s: int = Field(default=15, ge=1, le=3600, description="MQTT keep-alive in seconds")
    window: int = Field(
        default=200, ge=1, le=10_000, description="messages in flight without acknowledgement"
    )
    resend_s: float = Field(
        default=5.0, gt=0, description="seconds after which a message is sent again"
    )
    status_s: float = Field(default=5.0, gt=0, description="seconds between two status messages")
    drain_s: float = Field(
        default=3.0, ge=0, description="seconds to wait for acknowledgements when told to end"
    )


class IdentitySection(Section):
    """Who the node is, and to which site it seals."""

    directory: Path = Field(description="folder with key.pem, chain.pem and root.pem")
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


class LogSection(Section):
    """What is logged."""

    level: str = Field(default="INFO", description="DEBUG, INFO, WARNING or ERROR")


class NodeRenewalSection(RenewalSection):
    """As everywhere, but seldom: there may be many nodes."""

    every_s: float = Field(
        default=60.0, gt=0, le=86_400, description="seconds between two looks at the CA service"
    )


class NodeSettings(Settings):
    """All settings of a node."""

    node: NodeSection
    sampling: SamplingSection = SamplingSection()
    broker: BrokerSection = BrokerSection()
    identity: IdentitySection
    flash: FlashSection
    truth: TruthSection
    clock: ClockSection = ClockSection()
    renewal: NodeRenewalSection = NodeRenewalSection()
    log: LogSection = LogSection()
    taxel: tuple[Taxel, ...] = Field(
        min_length=1, max_length=100, description="the sensing elements; see the profiles"
    )

    @model_validator(mode="before")
    @classmethod
    def _take_profile(cls, data: Any) -> Any:
        """Fill in what the file leaves to a packaged profile."""
        node = data.get("node") if isinstance(data, dict) else None
        if not isinstance(node, dict) or node.get("profile") not in profile_names():
            return data
        profile = Profile.read(node["profile"])
        filled = {"taxel": profile.taxels} | data
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
