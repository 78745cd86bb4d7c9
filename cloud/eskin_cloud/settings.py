"""Settings of the cloud."""

from __future__ import annotations

from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import Field, StringConstraints, ValidationInfo, field_validator

from eskin.errors import SettingsError, shown
from eskin.runtime.net import is_loopback
from eskin.runtime.settings import Host, KeysSection, LogSection, RenewalSection, Section, Settings
from eskin_cloud.store.location import StoreLocation, is_local, parse_url


class StoreSection(Section):
    """Where data is kept."""

    url: str | None = Field(
        default=None,
        description="PostgreSQL server, `postgresql://USER@HOST:PORT/DATABASE`; by a Unix "
        "socket in a folder: `postgresql://USER@/DATABASE?host=FOLDER`; the primary of several "
        "servers: `postgresql://USER@/DATABASE?host=HOST:PORT&host=HOST:PORT`",
    )
    path: Path | None = Field(
        default=None,
        validate_default=True,
        description="SQLite file, where there is no `store.url`; made, with its folder, where "
        "there is none",
    )
    password_file: Path | None = Field(
        default=None,
        description="file with the server's password; without it libpq's own, such as `PGPASSFILE`",
    )
    root: Path | None = Field(
        default=None,
        validate_default=True,
        description="root certificate (PEM) that the server's leads to; needed beyond loopback",
    )
    readers: int = Field(default=4, ge=1, le=64, description="connections that read at once")
    queue: int = Field(
        default=64, ge=1, le=10_000, description="writes that may wait; more are answered with 503"
    )
    dead_letters: int = Field(
        default=10_000, ge=1, description="dead letters kept; the oldest goes first, and is counted"
    )

    @field_validator("url")
    @classmethod
    def _is_ours(cls, value: str | None) -> str | None:
        if value is not None:
            parse_url(value)
        return value

    @field_validator("path")
    @classmethod
    def _one_place(cls, value: Path | None, info: ValidationInfo) -> Path | None:
        url = info.data.get("url")
        if "url" in info.data and (value is None) == (url is None):
            what = "is missing" if value is None else f"stands beside store.url, {shown(url)}"
            raise ValueError(f"{what}; name an SQLite file here, or a server in store.url")
        return value

    @field_validator("root")
    @classmethod
    def _plain_stays_here(cls, value: Path | None, info: ValidationInfo) -> Path | None:
        url = info.data.get("url")
        if url is not None and value is None and not is_local(parse_url(url)):
            raise ValueError(
                f"plaintext stays on loopback, and store.url is {shown(url)}; name the root "
                "certificate that the server's own leads to"
            )
        return value

    @property
    def place(self) -> StoreLocation:
        """Where the store is.

        Raises:
            SettingsError: The password cannot be read.
        """
        if self.url is None:
            assert self.path is not None  # noqa: S101 - one of the two is there, see above
            return self.path
        url = parse_url(self.url)
        if self.password_file is not None:
            url = url.set(password=_read_secret(self.password_file))
        if self.root is not None:
            encrypted = {"sslmode": "verify-full", "sslrootcert": str(self.root)}
            url = url.update_query_dict(encrypted)
        return url


def _read_secret(path: Path) -> str:
    try:
        secret = path.read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError("store.password_file", f"{path} cannot be read: {error}") from error
    if not secret:
        raise SettingsError("store.password_file", f"{path} is empty; write the password there")
    return secret


class PeopleSection(Section):
    """The listener for people: REST, live, dashboard."""

    host: Host = Field(default="127.0.0.1", description="address to listen on")
    port: int = Field(default=8080, ge=0, le=65535, description="port; 0 takes a free one")
    identity: Path | None = Field(
        default=None,
        validate_default=True,
        description="folder with chain.pem and key.pem for HTTPS; without it plain HTTP, "
        "on loopback only",
    )

    names: list[Annotated[str, StringConstraints(to_lower=True, min_length=1)]] = Field(
        default=[],
        description="names that `Host` may have over plain HTTP, beside addresses, `localhost` and "
        "`people.host`, such as that of a reverse proxy; others are answered with 421",
    )
    proxies: list[IPv4Network | IPv6Network] = Field(
        default=[],
        description="networks (CIDR) of reverse proxies, whose forwarded client addresses are "
        "trusted; their connections have no bound of one address",
    )
    forwarded: Literal["x-forwarded-for", "forwarded"] = Field(
        default="x-forwarded-for",
        description="header in which the proxies name the client; they must set it themselves",
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
    """The listener for gateways: ingest, by HTTPS with a gateway's certificate only."""

    host: Host = Field(default="127.0.0.1", description="address to listen on")
    port: int = Field(default=8443, ge=0, le=65535, description="port; 0 takes a free one")
    identity: Path = Field(
        description="folder of the server's identity; gateway certificates lead to its root.pem"
    )
    revocations: Path | None = Field(
        default=None, description="the gateways' revocation list (PEM); read again when it changes"
    )
    body_bytes: int = Field(
        default=8_388_608, ge=65_536, le=134_217_728, description="bytes that one batch may have"
    )
    uploads_bytes: int = Field(
        default=134_217_728,
        ge=134_217_728,
        description="bytes of all batches that are not stored yet; more are answered with 503",
    )


class NodesSection(Section):
    """How nodes are judged."""

    revocations: Path | None = Field(
        default=None,
        description="the nodes' revocation list (PEM); read again when it changes. A revoked "
        "certificate makes no node known",
    )
    late_s: float = Field(
        default=5.0, gt=0, le=86_400, description="seconds of silence after which a node is late"
    )
    silence_s: float = Field(
        default=15.0, gt=0, le=86_400, description="seconds of silence after which it is offline"
    )
    clock_error_s: float = Field(
        default=1.0,
        ge=0,
        le=3600,
        description="greatest error of the clocks of gateways and clouds, by which nodes' clocks "
        "are checked",
    )
    missing_s: float = Field(
        default=300.0,
        gt=0,
        le=604_800,
        description="seconds after which messages that are missing between stored ones, and that "
        "no gap names, are reported by an event, a metric and the node",
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
        default=768,
        ge=1,
        le=100_000,
        description="connections open at once, of each listener; for more, the longest idle is "
        "closed",
    )
    connections_of_one: int = Field(
        default=256,
        ge=1,
        le=100_000,
        description="of these, of one token, session or certificate, else from one address (IPv4, "
        "or an IPv6 network of 64 bit); for more, the longest idle is closed",
    )


class RetentionSection(Section):
    """How long channels are kept; what is older is removed, a little at a time, and counted."""

    days: float = Field(
        default=0.0, ge=0, le=36_500, description="days that a channel is kept; 0: forever"
    )
    biometric_days: float = Field(
        default=0.0,
        ge=0,
        le=36_500,
        description="days that a biometric channel is kept; 0: as long as others",
    )
    channels: dict[str, float] = Field(
        default={},
        description='days by NODE/CHANNEL, such as `"hand/*" = 7`; the first that fits counts '
        "before all others, and 0 is forever",
    )
    every_s: float = Field(
        default=60.0, gt=0, le=86_400, description="seconds between two looks for what is too old"
    )
    at_once: int = Field(
        default=500,
        ge=1,
        le=10_000,
        description="messages removed in one write",
    )

    @field_validator("channels")
    @classmethod
    def _are_days(cls, value: dict[str, float]) -> dict[str, float]:
        for place, days in value.items():
            if "/" not in place or not 0 <= days <= 36_500:
                raise ValueError(
                    f"{shown(place)} = {days!r} is no NODE/CHANNEL with 0 to 36500 days"
                )
        return value


class CompactionSection(Section):
    """Old frames become rows of their patches: the same values in a third of the bytes."""

    on: bool = Field(default=True, description="whether old frames are compacted")
    every_s: float = Field(
        default=60.0, gt=0, le=86_400, description="seconds between two looks for old frames"
    )
    after_min: float = Field(
        default=2.0,
        ge=0,
        le=10_080,
        description="minutes after which frames are compacted; a live stream that is resumed from "
        "before is notified that some are missing",
    )


class AlarmsSection(Section):
    """Receivers of alarms, beside the gateways, which publish them by MQTT."""

    webhooks: dict[Annotated[str, StringConstraints(pattern=r"^[a-z0-9-]{1,63}$")], str] = Field(
        default={},
        description='URLs that each change of an alarm is posted to, by a name: `"ops" = '
        '"https://ops.example/alarms"`',
    )
    webhook_secret_file: Path | None = Field(
        default=None,
        description="file with the secret that signs what webhooks are sent (Standard Webhooks, "
        "`whsec_…`); without it nothing is signed",
    )
    alertmanager: str | None = Field(
        default=None, description="URL of a Prometheus Alertmanager, which alarms are posted to"
    )
    root: Path | None = Field(
        default=None,
        description="root certificate (PEM) that these servers lead to; without it those of the "
        "system",
    )
    timeout_s: float = Field(
        default=10.0, gt=0, le=300, description="seconds until a receiver must have answered"
    )
    retry_max_s: float = Field(
        default=300.0, ge=1, le=86_400, description="longest pause between two attempts"
    )
    give_up_h: float = Field(
        default=72.0,
        gt=0,
        le=8_760,
        description="hours of failure after which a webhook is not sent a change any more; it is "
        "logged and counted",
    )
    days: float = Field(
        default=365.0,
        gt=0,
        le=36_500,
        description="days that alarms are kept after they are cleared",
    )

    @field_validator("webhooks")
    @classmethod
    def _are_urls(cls, value: dict[str, str]) -> dict[str, str]:
        for url in value.values():
            _require_url(url)
        return value

    @field_validator("alertmanager")
    @classmethod
    def _is_url(cls, value: str | None) -> str | None:
        if value is not None:
            _require_url(value)
        return value


def _require_url(text: str) -> None:
    try:
        url = urlsplit(text)
        host = url.hostname or ""
    except ValueError:
        url, host = urlsplit(""), ""
    if url.scheme not in {"http", "https"} or not host:
        raise ValueError(f"{shown(text)} is no URL; write https://HOST/PATH")
    if url.scheme == "http" and not is_loopback(host):
        raise ValueError(f"plain HTTP stays on loopback, and {shown(text)} is elsewhere; use https")


class LiveSection(Section):
    """The live stream."""

    subscribers: int = Field(default=256, ge=1, le=10_000, description="streams at once")
    recent: int = Field(
        default=2_000, ge=1, le=1_000_000, description="messages kept in memory for all streams"
    )
    recent_bytes: int = Field(
        default=33_554_432, ge=1_048_576, description="their bytes; older ones are read again"
    )
    backlog: int = Field(
        default=100_000, ge=1, description="messages that a resumed stream is given at most"
    )
    heartbeat_s: float = Field(
        default=10.0, gt=0, le=300, description="seconds between signs of life"
    )


class CloudSettings(Settings):
    """All settings of the cloud."""

    store: StoreSection
    people: PeopleSection = PeopleSection()
    gateways: GatewaysSection
    nodes: NodesSection = NodesSection()
    access: AccessSection = AccessSection()
    limits: LimitsSection = LimitsSection()
    live: LiveSection = LiveSection()
    retention: RetentionSection = RetentionSection()
    compaction: CompactionSection = CompactionSection()
    alarms: AlarmsSection = AlarmsSection()
    keys: KeysSection = KeysSection()
    renewal: RenewalSection = RenewalSection()
    log: LogSection = LogSection()
