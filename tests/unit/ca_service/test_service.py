"""The CA service enrols only holders of a token, and each token once."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import httpx
import pytest
from eskin_ca.client import enrol, enrol_fleet, fetch, fetch_anchor
from eskin_ca.http_client import NotReadyError
from eskin_ca.tokens import Tokens
from hypothesis import example, given
from hypothesis import strategies as st
from typer.testing import CliRunner

from eskin.cli.pki import pki
from eskin.errors import IdentityError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    Identity,
    IdentityKind,
    client_context,
    der,
    is_numbered,
    load_certificates,
    numbered,
)
from tests.support.identities import SITE
from tests.support.processes import ESKIN, Running, accepts, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@dataclass
class Service:
    """A running CA service, and the folder into which it put tokens."""

    url: str
    tokens: Path
    authority: Path
    process: Running


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("authority")
    port = free_port()
    config = folder / "ca.toml"
    names = [("node", "fingertip"), ("node", "palm"), ("gateway", "gateway.g1"), ("site", "site.a")]
    config.write_text(
        f'[ca]\ndirectory = "{folder / "ca"}"\nport = {port}\n'
        + "".join(
            f'[[identity]]\nkind = "{kind}"\nname = "{name}"\n'
            + ('site = "site.main"\n' if kind in {"node", "gateway"} else "")
            + f'directory = "{folder}"\n'
            for kind, name in names
        )
        + '[[identity]]\nkind = "node"\nname = "skin"\nsite = "site.main"\ncount = 12\n'
        + f'directory = "{folder}"\n'
    )
    argv = [ESKIN, "pki", "serve", "--config", str(config)]
    with Running(argv, log=folder / "log") as process:
        process.wait_for(lambda: accepts(port), "the CA service listens")
        yield Service(f"https://127.0.0.1:{port}", folder, folder / "ca", process)


def test_enrolled_identity_is_trusted_and_its_key_private(service: Service, tmp_path: Path) -> None:
    identity = enrol(service.url, service.tokens, "fingertip", tmp_path)
    trust = ChainVerifier(*load_certificates(service.tokens / "root.pem"))
    chain = [der(certificate) for certificate in identity.chain]
    assert trust.verify(chain, IdentityKind.NODE) == identity.certificate
    assert (tmp_path / "key.pem").stat().st_mode & 0o777 == 0o600


def test_lost_answer_can_be_asked_for_again_with_the_same_key(
    service: Service, tmp_path: Path
) -> None:
    first = enrol(service.url, service.tokens, "palm", tmp_path)
    (tmp_path / "chain.pem").unlink()
    again = enrol(service.url, service.tokens, "palm", tmp_path)
    assert again.certificate.public_key() == first.certificate.public_key()


def test_used_token_is_refused_for_another_key(service: Service, tmp_path: Path) -> None:
    enrol(service.url, service.tokens, "gateway.g1", tmp_path / "first")
    with pytest.raises(IdentityError, match="used before, for another key"):
        enrol(service.url, service.tokens, "gateway.g1", tmp_path / "second")


def test_certificate_can_be_fetched_once_it_is_issued(service: Service, tmp_path: Path) -> None:
    with pytest.raises(NotReadyError, match=r"no certificate was issued to 'site\.a' yet"):
        fetch(service.url, service.tokens, "site.a", tmp_path / "site.pem")
    site = enrol(service.url, service.tokens, "site.a", tmp_path / "site")
    fetch(service.url, service.tokens, "site.a", tmp_path / "site.pem")
    assert load_certificates(tmp_path / "site.pem")[0] == site.certificate


def test_anchor_of_a_kind_is_its_own_issuer(service: Service, tmp_path: Path) -> None:
    fetch_anchor(service.url, service.tokens, IdentityKind.NODE, tmp_path / "node.pem")
    (anchor,) = load_certificates(tmp_path / "node.pem")
    assert anchor.subject == anchor.issuer
    assert IdentityKind.NODE.issuer in anchor.subject.rfc4514_string()


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ({"token": "guess", "request": "no request"}, 403, "no PKCS #10 request"),
        ({"token": "guess"}, 422, "request: "),
        ({"token": "x", "request": "y", "kind": "gateway"}, 422, "kind: "),
        ({"token": "x" * 300, "request": "y"}, 422, "at most 200"),
    ],
)
def test_bad_enrolment_is_refused_with_its_reason(
    service: Service, body: dict[str, str], status: int, words: str
) -> None:
    context = client_context(service.tokens / "root.pem")
    with httpx.Client(verify=context, timeout=60) as client:
        answer = client.post(f"{service.url}/enrol", json=body)
    assert answer.status_code == status
    assert words in answer.text


def test_listener_has_bounds_and_answers_keep_browsers_from_harm(service: Service) -> None:
    context = client_context(service.tokens / "root.pem")
    with httpx.Client(verify=context, base_url=service.url, timeout=60) as client:
        assert client.post("/enrol", content=b"a" * 70_000).status_code == 413
        assert client.get("/healthz", headers={"X": "a" * 40_000}).status_code == 431
        answer = client.get("/healthz")
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["strict-transport-security"]


def test_unknown_token_is_refused(service: Service, tmp_path: Path) -> None:
    (tmp_path / "root.pem").write_bytes((service.tokens / "root.pem").read_bytes())
    (tmp_path / "fingertip.token").write_text("guess")
    with pytest.raises(IdentityError, match="token is not known"):
        enrol(service.url, tmp_path, "fingertip", tmp_path / "out")


def test_service_of_another_ca_is_not_believed(service: Service, tmp_path: Path) -> None:
    other = CertificateAuthority.open(tmp_path / "other")
    (tmp_path / "root.pem").write_bytes(other.root_file.read_bytes())
    (tmp_path / "palm.token").write_text("secret")
    with pytest.raises(NotReadyError, match="CERTIFICATE_VERIFY_FAILED"):
        enrol(service.url, tmp_path, "palm", tmp_path / "out")


def enrol_skins(service: Service, out: Path, count: int) -> list[Identity]:
    return list(enrol_fleet(service.url, service.tokens, "skin", count, out, patience=20))


def test_fleet_enrols_with_one_token_and_goes_on_where_it_was_cut_off(
    service: Service, tmp_path: Path
) -> None:
    command = [
        ESKIN, "pki", "enrol", "--url", service.url, "--enrol-dir", str(service.tokens),
        "--kind", "node", "--name", "skin", "--count", "12", "--out", str(tmp_path),
    ]  # fmt: skip
    with Running(command, log=tmp_path / "log") as cut:
        # Where the machine stops at us alone, all are enrolled by now.
        wait_until((tmp_path / "skin-0003" / "chain.pem").exists, "some are enrolled")
        cut.kill()
    first = Identity.load(tmp_path / "skin-0001")
    # An answer that was lost: the key is there, its certificate is not.
    (tmp_path / "skin-0002" / "chain.pem").unlink()
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert "skin-0001 to skin-0012" in done.stdout
    found = enrol_skins(service, tmp_path, 12)
    assert [own.name for own in found] == numbered("skin", 12)
    assert found[0].certificate == first.certificate
    trust = ChainVerifier(*load_certificates(service.tokens / "root.pem"))
    for own in found:
        trust.verify([der(certificate) for certificate in own.chain], IdentityKind.NODE)
    listed = CliRunner().invoke(pki, ["tokens", "--dir", str(service.authority)])
    row = next(line.split() for line in listed.stdout.splitlines() if "skin" in line)
    assert row[:5] == ["skin", "node", SITE, "12", "12"]
    with pytest.raises(IdentityError, match="skin-0001, for another key"):
        enrol_skins(service, tmp_path / "thief", 1)
    with pytest.raises(IdentityError, match="good for skin-0001 to skin-0012, not for 'skin-0013'"):
        enrol_skins(service, tmp_path, 13)


def test_fleet_waits_for_a_service_that_is_away(tmp_path: Path, service: Service) -> None:
    asked = enrol_fleet(
        f"https://127.0.0.1:{free_port()}", service.tokens, "skin", 1, tmp_path, patience=0
    )
    with pytest.raises(IdentityError, match=r"gave up after 0 s: .*cannot be reached"):
        next(asked)


def test_token_of_a_fleet_is_good_for_its_names_alone_and_expires(tmp_path: Path) -> None:
    now = [datetime.now(UTC)]
    tokens = Tokens(tmp_path / "tokens.json", clock=lambda: now[0])
    first = tokens.create(
        IdentityKind.NODE, "skin", (), timedelta(hours=1), lines=0, site=SITE, count=3
    )
    tokens.exclude(["skin-0003"])
    assert tokens.redeem(first, b"key", "skin-0001").name == "skin-0001"
    for name in ("skin-0004", "skin-0000", "skin-1", "skin-0001x", "skin", "", "other-0001"):
        with pytest.raises(IdentityError, match="is good for skin-0001 to skin-0003, not for"):
            tokens.redeem(first, b"key", name)
    with pytest.raises(IdentityError, match="used before for skin-0003"):
        tokens.redeem(first, b"key", "skin-0003")
    second = tokens.create(
        IdentityKind.NODE, "skin", (), timedelta(hours=1), lines=0, site=SITE, count=3
    )
    reopened = Tokens(tmp_path / "tokens.json", clock=lambda: now[0])
    with pytest.raises(IdentityError, match="not known"):
        reopened.redeem(first, b"key", "skin-0002")
    with pytest.raises(IdentityError, match="skin-0001, for another key"):
        reopened.redeem(second, b"other", "skin-0001")
    assert [(each.name, used) for each, used in reopened.listed()] == [("skin", 2)]
    now[0] += timedelta(hours=2)
    with pytest.raises(IdentityError, match="expired"):
        reopened.redeem(second, b"key", "skin-0002")
    kept = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert second.encode() not in kept


@given(st.text(max_size=9), st.integers(1, 200), st.integers(-5, 300))
@example("", 12_000, 9_999)
def test_numbered_names_are_known_again(other: str, count: int, number: int) -> None:
    names = numbered("a-1", count)
    assert is_numbered(names[number % count], "a-1", count)
    assert is_numbered(f"a-1-{other}", "a-1", count) == (f"a-1-{other}" in names)
    assert is_numbered(f"a-1-{number:04}", "a-1", count) == (f"a-1-{number:04}" in names)


def test_ca_keys_are_private(service: Service) -> None:
    keys = list(service.authority.rglob("*.key")) + list(service.authority.rglob("key.pem"))
    assert len(keys) == 7
    assert all(key.stat().st_mode & 0o077 == 0 for key in keys)


def test_new_token_voids_the_older_one(tmp_path: Path) -> None:
    tokens = Tokens(tmp_path / "tokens.json")
    first = tokens.create(IdentityKind.NODE, "palm", (), timedelta(hours=1), lines=0, site=SITE)
    second = tokens.create(IdentityKind.NODE, "palm", (), timedelta(hours=1), lines=0, site=SITE)
    reopened = Tokens(tmp_path / "tokens.json")
    with pytest.raises(IdentityError, match="not known"):
        reopened.redeem(first, b"key")
    assert reopened.redeem(second, b"key").name == "palm"
    assert first.encode() not in (tmp_path / "tokens.json").read_bytes()


def test_expired_token_is_refused(tmp_path: Path) -> None:
    tokens = Tokens(tmp_path / "tokens.json")
    token = tokens.create(IdentityKind.NODE, "palm", (), timedelta(seconds=-1), lines=0, site=SITE)
    with pytest.raises(IdentityError, match="expired"):
        tokens.redeem(token, b"key")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('[ca]\ndirectory = "d"\nprot = 1\n', "ca.prot: no such setting"),
        pytest.param(
            '[ca]\ndirectory = "d"\nport = "x"\n',
            "ca.port: 'x' is not allowed",
            marks=pytest.mark.nightly,
        ),
        pytest.param("[ca]\n", "ca.directory: is missing", marks=pytest.mark.nightly),
        pytest.param(
            '[ca]\ndirectory="d"\n[[identity]]\nkind="node"\nname="a.b"\ndirectory="d"',
            "no name of a node",
            marks=pytest.mark.nightly,
        ),
        ("[authority\n", "is no TOML"),
    ],
)
def test_bad_configuration_is_one_clear_line_and_status_2(
    tmp_path: Path, content: str, words: str
) -> None:
    config = tmp_path / "ca.toml"
    config.write_text(content)
    done = subprocess.run(
        [ESKIN, "pki", "serve", "--config", str(config)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.nightly
def test_configuration_is_named_by_the_environment_too(tmp_path: Path) -> None:
    config = tmp_path / "ca.toml"
    config.write_text("[ca]\n")
    done = subprocess.run(
        [ESKIN, "pki", "serve"],
        capture_output=True, text=True, timeout=60, check=False,
        env=os.environ | {"ESKIN_CONFIG": str(config)},
    )  # fmt: skip
    assert done.returncode == 2
    assert "ca.directory: is missing" in done.stderr
