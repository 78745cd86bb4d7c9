"""Settings of the cloud."""

from __future__ import annotations

from ipaddress import ip_address
from pathlib import Path

from pydantic import Field, ValidationInfo, field_validator

from eskin.settings import RenewalSection, Section, Settings


def is_loopback(host: str) -> bool:
    """Whether an address, or the name localhost, stays on this machine."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class StoreSection(Section):
    """Where data is kept."""

    path: Path = Field(description="SQLite file; made, with its folder, where there is none")
    readers: int = Field(default=4, ge=1, le=64, description="connections that read at once")
    queue: int = Field(
        default=64, ge=1, le=10_000, description="writes that may wait; more are answered with 503"
    )
    dead_letters: int = Field(
        default=10_000, ge=1, description="dead letters kept; the oldest goes first, and is counted"
    )


class PeopleSection(Section):
    """The listener for people: REST, live, dashboard."""

    host: str = Field(default="127.0.0.1", description="address to listen on")
    port: int = Field(default=8080, ge=0, le=65535, description="port; 0 takes a free one")
    identity: Path | None = Field(
        default=None,
        validate_default=True,
        description="folder with chain.pem and key.pem for HTTPS; without it plain HTTP, "
        "on loopback only",
    )

    @field_validator("identity")
    @classmethod
    def _plain_stays_on_loopback(cls, value: Path | None, info: ValidationInfo) -> Path | None:
        host = info.data.get("host", "127.0.0.1")
        if value is None and not is_loopback(host):
            raise ValueError(
                f"plain HTTP stays on loopback, and people.host is {host!r}; use 127.0.0.1, ::1 "
                "or localhost there, or name a folder with a certificate here"
            )
        return value


class GatewaysSection(Section):
    """The listener for gateways: ingest, HTTPS only."""

    host: str = Field(default="127.0.0.1", description="address to listen on")
    port: int = Field(default=8443, ge=0, le=65535, description="port; 0 takes a free one")
    identity: Path = Field(
        description="folder of the server's identity; its root.pem is whom gateways must lead to"
    )
    audience: str = Field(
        default="eskin-cloud", min_length=1, max_length=100, description="audience of tokens"
    )
    revocations: Path | None = Field(
        default=None, description="the gateways' revocation list (PEM); read again when it changes"
    )
    body_bytes: int = Field(
        default=8_388_608, ge=65_536, le=134_217_728, description="bytes that one batch may have"
    )
    skew_s: float = Field(
        default=30.0, ge=0, le=300, description="seconds by which a gateway's clock may differ"
    )


class NodesSection(Section):
    """How nodes are judged."""

    late_s: float = Field(
        default=5.0, gt=0, le=86_400, description="seconds of silence after which a node is late"
    )
    silence_s: float = Field(
        default=15.0, gt=0, le=86_400, description="seconds of silence after which it is offline"
    )


class AccessSection(Section):
    """Sessions of people."""

    session_hours: float = Field(
        default=12.0, gt=0, le=8_760, description="hours until a session must sign in again"
    )


class LimitsSection(Section):
    """What one address may ask; one address is an IPv4 address or an IPv6 network of 64 bit."""

    requests_per_s: int = Field(
        default=2000, ge=1, le=1_000_000, description="requests a second, over ten seconds"
    )
    failures_per_min: int = Field(
        default=6000,
        ge=1,
        le=1_000_000,
        description="requests a minute without good credentials; more are answered with 429",
    )
    refusals_per_min: int = Field(
        default=30,
        ge=1,
        le=1_000_000,
        description="refused sign-ins a minute that the audit log keeps",
    )
    body_bytes: int = Field(
        default=65_536, ge=1024, le=16_777_216, description="bytes that a person's request may have"
    )
    connections: int = Field(
        default=768, ge=1, le=100_000, description="connections open at once, of each listener"
    )
    connections_of_one: int = Field(
        default=256, ge=1, le=100_000, description="of these, from one address"
    )


class LiveSection(Section):
    """The live stream."""

    subscribers: int = Field(default=100, ge=1, le=10_000, description="streams at once")
    recent: int = Field(
        default=2_000, ge=1, le=1_000_000, description="messages kept in memory for all streams"
    )
    backlog: int = Field(
        default=100_000, ge=1, description="messages that a resumed stream is given at most"
    )
    heartbeat_s: float = Field(
        default=10.0, gt=0, le=300, description="seconds between signs of life"
    )


class LogSection(Section):
    """What is logged."""

    level: str = Field(default="INFO", description="DEBUG, INFO, WARNING or ERROR")


class CloudSettings(Settings):
    """All settings of the cloud."""

    store: StoreSection
    people: PeopleSection = PeopleSection()
    gateways: GatewaysSection
    nodes: NodesSection = NodesSection()
    access: AccessSection = AccessSection()
    limits: LimitsSection = LimitsSection()
    live: LiveSection = LiveSection()
    renewal: RenewalSection = RenewalSection()
    log: LogSection = LogSection()
