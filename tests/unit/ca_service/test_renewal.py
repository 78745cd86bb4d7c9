"""Identities are renewed while their services run; revoked ones are not."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from eskin_ca.csr import make_request
from eskin_ca.renewal_service import RenewalService

from eskin.errors import IdentityError
from eskin.identity import (
    Identity,
    IdentityKind,
    client_context,
    finish_renewal,
    forget_past,
    install,
    is_due,
    new_key,
    next_key,
    past_identities,
)
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

LIFETIME = timedelta(hours=1)
GRACE = timedelta(hours=2)


class Rig:
    """A CA whose clock is turned by hand, and a node that asks it."""

    def __init__(self, folder: Path) -> None:
        self.own = Identities(folder)
        self.now = datetime.now(UTC)
        self.renewals = RenewalService(
            self.own.authority, lifetime=LIFETIME, grace=GRACE, clock=lambda: self.now
        )
        self.node = self.own.make(IdentityKind.NODE, "palm", lifetime=LIFETIME)

    def asked(self, own: Identity, topic: str = RENEWAL) -> bytes:
        request = make_request(next_key(own.directory), own.name)
        return sign(request.public_bytes(serialization.Encoding.DER), own=own, topic=topic)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_holder_gets_next_certificate_and_keeps_the_old_key(rig: Rig) -> None:
    renewed = install(rig.node.directory, rig.renewals.renew(rig.asked(rig.node)))
    assert renewed.name == "palm"
    assert renewed.kind is IdentityKind.NODE
    assert renewed.certificate.public_key() != rig.node.certificate.public_key()
    (past,) = past_identities(rig.node.directory)
    assert past.thumbprint == rig.node.thumbprint
    assert (past.directory / "key.pem").stat().st_mode & 0o777 == 0o600


def test_server_keeps_its_hosts(rig: Rig) -> None:
    server = rig.own.make(IdentityKind.SERVER, "server.cloud", hosts=["cloud", "127.0.0.1"])
    leaf = rig.renewals.renew(rig.asked(server))[0]
    old = server.certificate
    names = [
        str(cert.extensions.get_extension_for_class(x509.SubjectAlternativeName).value)
        for cert in (leaf, old)
    ]
    assert names[0] == names[1]
    assert "127.0.0.1" in names[0]


def test_lost_answer_can_be_asked_for_again(rig: Rig) -> None:
    assert rig.renewals.renew(rig.asked(rig.node)) == rig.renewals.renew(rig.asked(rig.node))
    assert sum(entry.name == "palm" for entry in rig.own.authority.issued()) == 2


def test_node_that_slept_through_its_end_is_renewed_within_grace_only(rig: Rig) -> None:
    asked = rig.asked(rig.node)
    rig.now += LIFETIME + GRACE + timedelta(minutes=1)
    with pytest.raises(IdentityError, match="too long ago"):
        rig.renewals.renew(asked)
    rig.now -= timedelta(minutes=2)
    assert rig.renewals.renew(asked)[0].public_key() != rig.node.certificate.public_key()


def test_certificate_of_a_retired_ca_is_not_renewed(rig: Rig) -> None:
    rig.own.authority.rotate(IdentityKind.NODE)
    rig.renewals.renew(rig.asked(rig.node))
    rig.own.authority.retire(IdentityKind.NODE)
    with pytest.raises(IdentityError, match="is retired; enrol it again"):
        rig.renewals.renew(rig.asked(rig.node))


def test_revoked_certificate_is_not_renewed(rig: Rig) -> None:
    rig.own.authority.revoke("palm")
    with pytest.raises(IdentityError, match="palm was revoked"):
        rig.renewals.renew(rig.asked(rig.node))


def test_request_of_another_is_refused(rig: Rig, tmp_path: Path) -> None:
    strange = Identities(tmp_path / "strange").make(IdentityKind.NODE, "palm")
    with pytest.raises(IdentityError, match="not issued by our CA"):
        rig.renewals.renew(rig.asked(strange))
    with pytest.raises(IdentityError, match="is wrong"):
        rig.renewals.renew(rig.asked(rig.node, topic="eskin/v1/nodes/palm/commands"))
    thief = Identity(rig.node.directory, new_key(), rig.node.chain, rig.node.roots)
    with pytest.raises(IdentityError, match="is wrong"):
        rig.renewals.renew(rig.asked(thief))
    for nonsense in (b"", b"x", sign(b"no request", own=rig.node, topic=RENEWAL)):
        with pytest.raises(IdentityError, match=r"no request to renew|no PKCS"):
            rig.renewals.renew(nonsense)


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_power_cut_between_key_and_chain_leaves_an_identity(rig: Rig, steps: int) -> None:
    folder = rig.node.directory
    before = (folder / CHAIN_FILE).read_bytes()
    chain = rig.renewals.renew(rig.asked(rig.node))
    new = next_key(folder)
    install(folder, chain)
    after = (folder / CHAIN_FILE).read_bytes()
    # As it was left after so many of the steps: the chain in ``next``, the key, the chain.
    (folder / "next" / CHAIN_FILE).write_bytes(after)
    Identity.save(folder / "next", key=new, chain=chain, roots=rig.node.roots)
    if steps == 0:
        past = past_identities(folder)[0].directory
        shutil.copy(past / "key.pem", folder / "key.pem")
    if steps < 2:
        (folder / CHAIN_FILE).write_bytes(before)
    expected = rig.node.certificate if steps == 0 else chain[0]
    assert Identity.load(folder).certificate == expected
    client_context(folder / ROOT_FILE, Identity.load(folder))
    finish_renewal(folder)
    assert Identity.load(folder).certificate == chain[0]
    assert next_key(folder).public_key() != new.public_key()


def test_certificate_is_due_with_a_third_left_and_past_key_goes_after_another_life(
    rig: Rig,
) -> None:
    end = rig.node.certificate.not_valid_after_utc
    assert not is_due(rig.node.certificate, end - LIFETIME / 3 - timedelta(seconds=2))
    assert is_due(rig.node.certificate, end - LIFETIME / 3 + timedelta(seconds=2))
    folder = rig.node.directory
    install(folder, rig.renewals.renew(rig.asked(rig.node)))
    forget_past(folder, end + LIFETIME - timedelta(seconds=2))
    assert len(past_identities(folder)) == 1
    forget_past(folder, end + LIFETIME + timedelta(seconds=2))
    assert past_identities(folder) == []


def test_past_key_that_was_half_forgotten_is_in_nobodys_way(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, later = rig.node.directory, rig.now + 3 * LIFETIME
    install(folder, rig.renewals.renew(rig.asked(rig.node)))

    def cut_off(path: Path) -> None:
        (path / "root.pem").unlink()
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(shutil, "rmtree", cut_off)
        with pytest.raises(KeyboardInterrupt):
            forget_past(folder, later)
    assert past_identities(folder) == []
    forget_past(folder, later)
    assert list((folder / "past").iterdir()) == []
