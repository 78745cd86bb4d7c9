"""A server shows a certificate that fits its key, whenever it is looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_cloud.jobs.certificates import ServerCertificate

from eskin.errors import IdentityError, SettingsError
from eskin.identity import Identity, IdentityKind, finish_renewal, install, next_key
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


def test_cloud_starts_in_the_middle_of_a_renewal(
    identities: Identities, own: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_off(identities, own, monkeypatch)
    shown = ServerCertificate("gateways.identity", own.directory)
    finish_renewal(own.directory)
    assert shown.refresh()
    assert not shown.refresh()


def test_renewed_certificate_that_could_not_be_taken_is_tried_again(
    identities: Identities, own: Identity, caplog: pytest.LogCaptureFixture
) -> None:
    shown = ServerCertificate("gateways.identity", own.directory)
    renew(identities, own)
    chain = own.directory / "chain.pem"
    whole = chain.read_bytes()
    chain.write_bytes(b"")
    for _ in range(3):
        assert not shown.refresh()
        assert "cannot be used" in str(shown.fault)
    assert len(caplog.records) == 1, "it is said once"
    chain.write_bytes(whole)
    assert shown.refresh()
    assert shown.fault is None


def test_certificate_for_which_the_moment_is_bad_is_tried_again(
    identities: Identities, own: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = ServerCertificate("gateways.identity", own.directory)
    renew(identities, own)

    def fail(*_: object) -> None:
        raise IdentityError("too many open files")

    with monkeypatch.context() as patched:
        patched.setattr("eskin_cloud.jobs.certificates.show", fail)
        assert not shown.refresh()
        assert shown.fault == "too many open files"
    assert shown.refresh()


def test_folder_without_a_certificate_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"chain\.pem and key\.pem cannot be used"):
        ServerCertificate("people.identity", tmp_path)
