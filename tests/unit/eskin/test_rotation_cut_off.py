"""A CA whose replacing was cut off, at whatever step, is replaced by the same command again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from eskin.errors import IdentityError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    IdentityKind,
    RootRotation,
    crl_publisher,
    der,
    identity,
    issuing_ca,
    load_certificates,
    new_key,
    roots,
    rotation,
)
from eskin.identity.ca import CA_SERVICE
from tests.support.identities import SITE, Identities

if TYPE_CHECKING:
    from collections.abc import Callable

NODE = IdentityKind.NODE
SERVER = IdentityKind.SERVER
WRITERS = identity, issuing_ca, crl_publisher, roots, rotation


class Cut(BaseException):
    """The process ends here."""


@pytest.fixture
def own(tmp_path: Path) -> Identities:
    return Identities(tmp_path / "pki")


def cut_off(monkeypatch: pytest.MonkeyPatch, work: Callable[[], object], *, after: int) -> None:
    """Do some work, and be ended after so many files were written."""
    left, write = after, identity.write_whole

    def count(path: Path, data: bytes, *, mode: int = 0o644) -> None:
        nonlocal left
        if left == 0:
            raise Cut
        left -= 1
        write(path, data, mode=mode)

    with monkeypatch.context() as patched:
        for module in WRITERS:
            patched.setattr(module, "write_whole", count)
        with pytest.raises(Cut):
            work()


def require_whole(ca: Path, *, issuers: int) -> None:
    """Require that each kind's newest certificate passes, and nothing lies beside what stands."""
    authority = CertificateAuthority(ca)
    for kind, name in ((NODE, "palm"), (SERVER, "server.cloud")):
        chain = authority.issue(
            kind, name, new_key().public_key(), site=SITE if kind is NODE else ""
        )
        trust = ChainVerifier(*authority.roots)
        trust.revocations(kind, authority.revocations_file(kind).read_bytes())
        trust.verify([der(one) for one in chain], kind)
    assert len(load_certificates(ca / "node.pem")) == issuers
    if issuers == 1:
        assert len(load_certificates(authority.anchor_file(NODE))) == 1
        assert len(list(ca.glob("node*key"))) == 1


@pytest.mark.parametrize("after", range(4))
def test_rotation_of_a_kind_goes_on(
    own: Identities, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    cut_off(monkeypatch, lambda: own.authority.rotate(NODE), after=after)
    again = CertificateAuthority(own.ca)
    again.rotate(NODE)
    require_whole(own.ca, issuers=2)
    with pytest.raises(IdentityError, match="is being replaced already"):
        again.rotate(NODE)
    again.retire(NODE)
    require_whole(own.ca, issuers=1)


def test_service_completes_a_rotation_at_its_start(
    own: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_off(monkeypatch, lambda: own.authority.rotate(NODE), after=3)
    assert own.authority.must_refresh(NODE)
    CertificateAuthority.open(own.ca)
    assert not own.authority.must_refresh(NODE)
    require_whole(own.ca, issuers=2)


@pytest.mark.parametrize("after", range(3))
def test_retirement_of_a_kind_goes_on(
    own: Identities, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    own.authority.rotate(NODE)
    cut_off(monkeypatch, lambda: own.authority.retire(NODE), after=after)
    again = CertificateAuthority(own.ca)
    again.retire(NODE)
    require_whole(own.ca, issuers=1)
    with pytest.raises(IdentityError, match="no node CA is being replaced"):
        again.retire(NODE)


@pytest.mark.parametrize("after", [0, 1, 2, 3, 4, 5, 8, 17, 18, 20, 22])
def test_rotation_of_the_root_goes_on_and_the_service_meanwhile(
    own: Identities, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    cut_off(monkeypatch, RootRotation(own.authority).begin, after=after)
    again = CertificateAuthority(own.ca)
    again.issue(SERVER, CA_SERVICE, new_key().public_key())
    RootRotation(again).begin()
    assert len(again.roots) == 2
    require_whole(own.ca, issuers=2)
    with pytest.raises(IdentityError, match="is being replaced already"):
        RootRotation(again).begin()


@pytest.mark.parametrize("after", [0, 1, 2, 3, 7, 15, "unlink"])
def test_retirement_of_the_root_goes_on(
    own: Identities, monkeypatch: pytest.MonkeyPatch, after: int | str
) -> None:
    RootRotation(own.authority).begin()
    RootRotation(own.authority).switch()
    if isinstance(after, int):
        cut_off(monkeypatch, RootRotation(own.authority).retire, after=after)
    else:
        unlink = Path.unlink

        def cut(path: Path, *, missing_ok: bool = False) -> None:
            if path.name.startswith("root."):
                raise Cut
            unlink(path, missing_ok=missing_ok)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "unlink", cut)
            with pytest.raises(Cut):
                RootRotation(own.authority).retire()
    RootRotation(CertificateAuthority(own.ca)).retire()
    require_whole(own.ca, issuers=1)
    assert len(CertificateAuthority(own.ca).roots) == 1
    assert len(list(own.ca.glob("root*key"))) == 1
    assert not (own.ca / "root.cross.pem").exists()
