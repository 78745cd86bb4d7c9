"""The demo renews its identities while it runs, except revoked ones."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from eskin.demo.identities import prepare_identities, renew_identities
from eskin.demo.layout import DemoFolder
from eskin.identity import CertificateAuthority, Identity, past_identities

if TYPE_CHECKING:
    from pathlib import Path

AGED = timedelta(milliseconds=1)
LIFETIME = timedelta(hours=1)


def test_what_is_due_is_renewed_and_what_was_revoked_is_not(tmp_path: Path) -> None:
    layout = DemoFolder(tmp_path)
    nodes = ["fingertip", "palm"]
    assert prepare_identities(layout, nodes, lifetime=AGED) == []
    names = [*nodes, "site.demo", "server.broker", "gateway.demo"]
    first = {name: Identity.load(layout.identity(name)) for name in names}
    CertificateAuthority(layout.authority).revoke("palm")
    renew_identities(layout, nodes, lifetime=LIFETIME)
    second = {name: Identity.load(layout.identity(name)).thumbprint for name in names}
    changed = {name for name in names if second[name] != first[name].thumbprint}
    assert changed == set(names) - {"palm"}
    renew_identities(layout, nodes, lifetime=LIFETIME)
    third = {name: Identity.load(layout.identity(name)).thumbprint for name in names}
    assert third == second
    assert past_identities(layout.identity("palm")) == []
