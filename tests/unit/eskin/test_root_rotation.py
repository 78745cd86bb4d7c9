"""The root CA is replaced in steps, and no step can be taken too early."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import pytest

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    Identity,
    IdentityKind,
    RootRotation,
    client_context,
    der,
    is_superseded,
    load_certificates,
    server_context,
)
from eskin.identity.ca import CA_SERVICE
from eskin.identity.certificates import pem
from eskin.identity.identity import ROOT_FILE, write_whole
from eskin.identity.roots import accept_roots, offered_roots
from tests.support.identities import Identities

if TYPE_CHECKING:
    import ssl
    from pathlib import Path

    from cryptography import x509

NODE = IdentityKind.NODE
SERVER = IdentityKind.SERVER


@pytest.fixture
def own(tmp_path: Path) -> Identities:
    return Identities(tmp_path / "pki")


def chain_of(identity: Identity) -> list[bytes]:
    return [der(certificate) for certificate in identity.chain]


def tell_roots(own: Identities, identity: Identity) -> None:
    """Bring the roots to a party, as its keeper does."""
    write_whole(identity.directory / ROOT_FILE, own.authority.root_file.read_bytes())


def passes(trust: ChainVerifier, identity: Identity) -> bool:
    try:
        trust.verify(chain_of(identity), identity.kind)
    except UntrustedCertificateError:
        return False
    return True


def test_old_root_passes_until_it_is_retired(own: Identities) -> None:
    rotation = RootRotation(own.authority)
    trust = ChainVerifier.following(own.site.directory / ROOT_FILE)
    rotation.begin()
    assert own.make(NODE, "early").chain[1] == own.node.chain[1], "the new root issues too early"
    tell_roots(own, own.site)
    trust.revocations(NODE, own.authority.revocations_file(NODE).read_bytes())
    rotation.switch()
    new = own.make(NODE, "palm")
    assert new.chain[1] != own.node.chain[1]
    assert passes(trust, own.node)
    assert passes(trust, new)
    rotation.retire()
    # By the list alone, before the root is gone from its file, and by the root alone.
    trust.revocations(NODE, own.authority.revocations_file(NODE).read_bytes())
    assert not passes(trust, own.node)
    tell_roots(own, own.site)
    assert not passes(ChainVerifier.following(own.site.directory / ROOT_FILE), own.node)
    assert passes(trust, new)
    for judge in (trust, ChainVerifier(*own.authority.roots)):
        judge.require_good(new.chain[0], new.chain[1], NODE)
        with pytest.raises(UntrustedCertificateError, match="not issued by our CA"):
            judge.require_good(own.node.chain[0], own.node.chain[1], NODE)
    assert len(list(own.ca.glob("*.key"))) == 1 + len(IdentityKind)


def test_identity_that_leads_to_the_old_root_is_named_and_knows_it(own: Identities) -> None:
    rotation = RootRotation(own.authority)
    rotation.begin()
    assert rotation.dependants() == []
    tell_roots(own, own.node)
    assert not is_superseded(Identity.load(own.node.directory))
    rotation.switch()
    tell_roots(own, own.node)
    assert is_superseded(Identity.load(own.node.directory))
    assert rotation.dependants() == ["fingertip", "gateway.g1", "site.main"]
    assert not is_superseded(own.make(NODE, "fingertip"))
    assert rotation.dependants() == ["gateway.g1", "site.main"]


def test_service_stays_known_to_who_knows_the_old_root_alone(own: Identities) -> None:
    sleeper = ChainVerifier(*own.authority.roots)
    rotation = RootRotation(own.authority)
    rotation.begin()
    rotation.switch()
    assert passes(sleeper, own.make(SERVER, CA_SERVICE))
    assert not passes(sleeper, own.make(SERVER, "server.cloud"))
    rotation.retire()
    assert not passes(sleeper, own.make(SERVER, CA_SERVICE))


def test_root_without_a_voucher_is_refused(own: Identities, tmp_path: Path) -> None:
    (old,) = trusted = own.authority.roots
    RootRotation(own.authority).begin()
    good = offered(own.ca)
    assert accept_roots(trusted, good, datetime.now(UTC)) == own.authority.roots
    new = own.authority.roots[1]
    outsider = CertificateAuthority.open(tmp_path / "outsider")
    RootRotation(outsider).begin()
    forged = [offered(outsider.directory), [old, new], [old, *outsider.roots, *good[2:]], []]
    for each in forged:
        with pytest.raises(UntrustedCertificateError, match="no root"):
            accept_roots(trusted, each, datetime.now(UTC))


def offered(ca: Path) -> list[x509.Certificate]:
    path = ca / "offered.pem"
    path.write_bytes(offered_roots(ca))
    return list(load_certificates(path))


def test_steps_are_refused_out_of_turn_and_go_on_where_they_were_cut_off(own: Identities) -> None:
    rotation = RootRotation(own.authority)
    for step in (rotation.switch, rotation.retire, rotation.age):
        with pytest.raises(IdentityError, match="no root is being replaced"):
            step()
    rotation.begin()
    with pytest.raises(IdentityError, match="does not issue yet"):
        rotation.retire()
    with pytest.raises(IdentityError, match="being replaced already"):
        rotation.begin()
    with pytest.raises(IdentityError, match="being replaced already"):
        own.authority.rotate(NODE)
    with pytest.raises(IdentityError, match="retire --root"):
        own.authority.retire(NODE)
    # As a power cut in the middle of the first step would have left it.
    write_whole(own.ca / "node.pem", pem([own.node.chain[1]]))
    with pytest.raises(IdentityError, match="no new node CA yet"):
        rotation.switch()
    rotation.begin()
    rotation.switch()
    rotation.switch()
    rotation.retire()
    own.authority.rotate(NODE)
    assert passes(ChainVerifier(*own.authority.roots), own.make(NODE, "palm"))


def shakes_hands(client: ssl.SSLContext, server: ssl.SSLContext) -> bool:
    """Whether both sides of a connection find the other one good."""
    ours, theirs = socket.socketpair()

    def serve() -> None:
        with suppress(OSError), theirs, server.wrap_socket(theirs, server_side=True) as secured:
            secured.recv(1)
            secured.send(b"!")

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        with ours, client.wrap_socket(ours, server_hostname="localhost") as secured:
            secured.send(b"?")
            return secured.recv(1) == b"!"
    except OSError:
        return False
    finally:
        thread.join()


def test_contexts_in_use_take_new_roots_and_drop_old_ones(own: Identities) -> None:
    server = own.make(SERVER, "server.cloud")
    client = client_context(own.node.directory / ROOT_FILE, own.node)
    context = server_context(server.directory, client_certificates=True)
    outsider = client_context(own.gateway.directory / ROOT_FILE, own.gateway)
    rotation = RootRotation(own.authority)
    rotation.begin()
    for each in (own.node, server, own.gateway):
        tell_roots(own, each)
    assert shakes_hands(client, context)
    rotation.switch()
    own.make(SERVER, "server.cloud")
    assert shakes_hands(client, context)
    own.make(NODE, "fingertip")
    assert shakes_hands(client, context)
    assert shakes_hands(outsider, context)
    rotation.retire()
    tell_roots(own, server)
    assert not shakes_hands(outsider, context), "its certificate leads to the retired root"
    assert shakes_hands(client, context)
    (own.node.directory / ROOT_FILE).write_text("half a fi")
    assert shakes_hands(client, context)
