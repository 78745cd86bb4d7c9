"""A server shows a certificate that fits its key, whenever it is looked at."""

from __future__ import annotations

import ssl
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from eskin.errors import IdentityError
from eskin.identity import (
    Identity,
    IdentityKind,
    der,
    finish_renewal,
    install,
    next_key,
    server_context,
)
from eskin.identity import renewal as renewal_module
from eskin.identity.identity import write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities

SERVER = IdentityKind.SERVER


@pytest.fixture
def own(identities: Identities) -> Identity:
    return identities.make(SERVER, "server.cloud")


class Cut(BaseException):
    """The process ends here."""


def renew(identities: Identities, own: Identity) -> None:
    key = next_key(own.directory).public_key()
    install(own.directory, identities.authority.issue(SERVER, own.name, key))


def cut_off(identities: Identities, own: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    """Renew, and end between the new key and its chain."""

    def cut(path: Path, data: bytes) -> None:
        if path == own.directory / "chain.pem":
            raise Cut
        write_whole(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(renewal_module, "write_whole", cut)
        with pytest.raises(Cut):
            renew(identities, own)


def shown(context: ssl.SSLContext) -> bytes:
    """The certificate (DER) that a server shows to a client."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = client.wrap_bio(down, up), context.wrap_bio(up, down, server_side=True)
    for _ in range(4):
        for end in ends:
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    return ends[0].getpeercert(binary_form=True) or b""


def test_server_starts_in_the_middle_of_a_renewal(
    identities: Identities, own: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_off(identities, own, monkeypatch)
    context = server_context(own.directory, client_certificates=False)
    renewed = shown(context)
    assert renewed != der(own.certificate)
    finish_renewal(own.directory)
    assert shown(context) == renewed == der(Identity.load(own.directory).certificate)


def test_unusable_renewal_leaves_the_certificate_and_is_tried_again(
    identities: Identities, own: Identity, caplog: pytest.LogCaptureFixture
) -> None:
    context = server_context(own.directory, client_certificates=False)
    renew(identities, own)
    chain = own.directory / "chain.pem"
    whole = chain.read_bytes()
    chain.write_bytes(b"")
    for _ in range(3):
        assert shown(context) == der(own.certificate)
    assert len(caplog.records) == 1
    chain.write_bytes(whole)
    assert shown(context) == der(Identity.load(own.directory).certificate) != der(own.certificate)


def test_renewal_that_fails_for_a_instant_is_tried_again(
    identities: Identities, own: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = server_context(own.directory, client_certificates=False)
    renew(identities, own)

    def fail(*_: object) -> None:
        raise IdentityError("too many open files")

    with monkeypatch.context() as patched:
        patched.setattr("eskin.identity.tls.show", fail)
        assert shown(context) == der(own.certificate)
    assert shown(context) == der(Identity.load(own.directory).certificate)


def test_folder_without_a_certificate_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(IdentityError):
        server_context(tmp_path, client_certificates=False)
