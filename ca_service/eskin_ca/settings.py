"""Settings of the CA service."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, field_validator, model_validator

from eskin.errors import IdentityError
from eskin.identity import IdentityKind, numbered
from eskin.runtime.settings import Host, LogSection, Section, Settings


class CaSection(Section):
    """Where the CA lives and listens."""

    directory: Path = Field(description="folder of the CA's keys; no other process needs it")
    host: Host = Field(default="127.0.0.1", description="address to listen on (HTTPS)")
    port: int = Field(default=8444, ge=1, le=65535, description="port to listen on")
    names: tuple[str, ...] = Field(
        default=("localhost", "127.0.0.1"),
        description="DNS names and addresses under which clients reach the service",
    )
    token_hours: float = Field(
        default=24.0, gt=0, description="hours for which a one-time enrolment token is good"
    )
    certificate_days: float = Field(
        default=90.0, gt=0, le=398, description="days for which a certificate is valid"
    )
    grace_days: float = Field(
        default=30.0,
        ge=0,
        le=398,
        description="days after its end in which a certificate may still be renewed",
    )
    requests_per_s: int = Field(
        default=500,
        ge=1,
        le=1_000_000,
        description="requests a second from one address (IPv4, or an IPv6 network of 64 bit), over "
        "ten seconds; more are answered with 429",
    )
    refusals_per_min: int = Field(
        default=600,
        ge=1,
        le=1_000_000,
        description="requests a minute from one address that are refused; more are answered with "
        "429",
    )


class Expected(Section):
    """An identity that may enrol: at start, its token is put into its folder."""

    kind: IdentityKind = Field(description="node, site, gateway, server or client")
    name: str = Field(description="common name; of a fleet, what its nodes' names begin with")
    site: str = Field(
        default="",
        description="the site of a node or gateway, such as site.main; other kinds have none",
    )
    count: int = Field(
        default=0,
        ge=0,
        le=100_000,
        description="one token for so many nodes, NAME-0001 and so on; 0: for one name",
    )
    hosts: tuple[str, ...] = Field(default=(), description="a server's names and addresses")
    directory: Path = Field(description="folder that takes NAME.token and root.pem")

    @model_validator(mode="after")
    def _name_fits_kind(self) -> Self:
        try:
            self.kind.require_name(self.name)
            self.kind.require_site(self.site)
            if self.count:
                self.kind.require_name(numbered(self.name, self.count)[-1])
        except IdentityError as error:
            raise ValueError(str(error)) from error
        if self.count and self.kind is not IdentityKind.NODE:
            raise ValueError(f"count = {self.count}: only nodes make a fleet")
        return self


class CaSettings(Settings):
    """All settings of the CA service."""

    ca: CaSection
    log: LogSection = LogSection()
    identity: tuple[Expected, ...] = Field(default=(), description="identities that may enrol")

    @field_validator("identity")
    @classmethod
    def _names_are_unique(cls, value: tuple[Expected, ...]) -> tuple[Expected, ...]:
        names = [expected.name for expected in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"named twice: {', '.join(twice)}")
        return value
