"""Settings of the gateway."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator

from eskin.runtime.net import is_loopback
from eskin.runtime.settings import Host, KeysSection, LogSection, RenewalSection, Section, Settings
from eskin.wire.topics import HOME_ASSISTANT


class BrokerSection(Section):
    """The MQTT broker."""

    host: Host = Field(
        default="localhost", description="broker's name or address, as in its certificate"
    )
    port: int = Field(default=8883, ge=1, le=65535, description="broker's TLS port")
    protocol: Literal["3.1.1", "5"] = Field(default="3.1.1", description="MQTT version: 3.1.1 or 5")
    keepalive_s: int = Field(default=15, ge=1, le=3600, description="seconds between pings")
    group: str = Field(
        default="",
        pattern=r"^[A-Za-z0-9_-]{0,64}$",
        description="shared subscription ($share) for frames and events; empty: not shared",
    )
    receive_queue_messages: int = Field(
        default=4096,
        ge=16,
        le=65535,
        description="messages between broker and spool; more than the broker's window",
    )
    receive_queue_bytes: int = Field(
        default=67_108_864,
        ge=1_048_576,
        description="their bytes; when full, the gateway stops reading",
    )


class IdentitySection(Section):
    """The gateway's identity and its site's keys."""

    directory: Path = Field(description="folder of the gateway's identity")
    site: Path = Field(description="folder of the site's identity, to which nodes seal messages")
    revocations: Path | None = Field(
        default=None, description="the nodes' revocation list (PEM); reloaded when it changes"
    )


CloudUrl = Annotated[str, StringConstraints(pattern=r"^https://[^\s/@]+(/\S*)?$")]
"""The ingest of a cloud."""


class CloudSection(Section):
    """The cloud's ingest."""

    url: CloudUrl = Field(
        default="https://localhost:8443/api/v1/ingest",
        description="cloud's ingest; https only; commands come from `deliveries` beside it",
    )
    fallbacks: list[CloudUrl] = Field(
        default=[],
        max_length=16,
        description="ingests of other clouds on the same store; nodes are shared out evenly, and "
        "those of a cloud that fails go to the next",
    )
    timeout_s: float = Field(
        default=10.0, gt=0, le=600, description="seconds to wait for a response"
    )
    batch_messages: int = Field(default=512, ge=1, le=10_000, description="messages in one request")
    batch_bytes: int = Field(
        default=4_194_304, ge=65_536, le=67_108_864, description="bytes of messages in one request"
    )
    retry_s: float = Field(default=0.5, gt=0, le=60, description="seconds before the first retry")
    retry_max_s: float = Field(
        default=30.0, gt=0, le=3600, description="most seconds between retries"
    )


class CommandsSection(Section):
    """Commands from the cloud to nodes."""

    wait_s: float = Field(
        default=20.0,
        ge=0,
        le=60,
        description="seconds that the cloud may hold a request for commands",
    )
    resend_s: float = Field(
        default=5.0,
        gt=0,
        le=3600,
        description="seconds before an unanswered command is resent",
    )


class SpoolSection(Section):
    """The durable spool."""

    path: Path = Field(description="SQLite file")
    capacity_bytes: int = Field(
        default=1_073_741_824, ge=2_097_152, description="most bytes of messages"
    )
    dead_letters: int = Field(
        default=10_000, ge=1, description="most dead letters; the oldest is dropped and counted"
    )
    batch_messages: int = Field(default=256, ge=1, le=900, description="messages in one commit")
    batch_ms: float = Field(
        default=10.0,
        ge=0,
        le=1000,
        description="milliseconds to wait for more messages in one commit",
    )


class SiteKeysSection(KeysSection):
    """The site's key store; by default the folder `keys` beside the spool."""

    share: bool = Field(
        default=False,
        description="whether the cloud gets the keys, to show biometric channels to tokens with "
        "the scope `biometric`",
    )


class HttpSection(Section):
    """Health and metrics."""

    host: Host = Field(default="127.0.0.1", description="loopback address to listen on")
    port: int = Field(default=9464, ge=0, le=65535, description="port; 0: any free one")
    requests_per_s: int = Field(
        default=20, ge=1, le=1_000_000, description="requests a second, over ten seconds"
    )
    connections: int = Field(
        default=32,
        ge=1,
        le=100_000,
        description="open connections; for one more, the one idle longest is closed",
    )

    @field_validator("host")
    @classmethod
    def _is_loopback(cls, value: str) -> str:
        if not is_loopback(value):
            raise ValueError("plain HTTP stays on loopback; use 127.0.0.1, ::1 or localhost")
        return value


class NodesSection(Section):
    """How long the gateway waits for nodes."""

    silence_s: float = Field(
        default=15.0,
        gt=0,
        le=86_400,
        description="seconds without a message after which a node is offline",
    )
    layout_wait_s: float = Field(
        default=600.0,
        gt=0,
        le=86_400,
        description="seconds for which frames wait for a layout that their node was asked for",
    )


class PublicSection(Section):
    """What is published besides the plain JSON of `eskin/v1/live`."""

    homeassistant: bool = Field(
        default=False, description="whether channels are announced to Home Assistant"
    )
    homeassistant_prefix: str = Field(
        default=HOME_ASSISTANT,
        pattern=r"^[A-Za-z0-9_-]{1,64}$",
        description="its discovery topic; the broker's ACL must allow another one",
    )
    homeassistant_expire_days: float = Field(
        default=30.0,
        gt=0,
        le=3650,
        description="days without a status after which a node's channels are removed",
    )
    senml: bool = Field(
        default=False, description="whether hulls are published as SenML, too (`eskin/v1/senml`)"
    )


class GatewaySettings(Settings):
    """All settings of a gateway."""

    broker: BrokerSection = BrokerSection()
    identity: IdentitySection
    cloud: CloudSection = CloudSection()
    commands: CommandsSection = CommandsSection()
    spool: SpoolSection
    http: HttpSection = HttpSection()
    nodes: NodesSection = NodesSection()
    keys: SiteKeysSection = SiteKeysSection()
    renewal: RenewalSection = RenewalSection()
    public: PublicSection = PublicSection()
    log: LogSection = LogSection()

    @property
    def keystore(self) -> Path:
        """Folder of the key store."""
        return self.keys.directory or self.spool.path.with_name("keys")
