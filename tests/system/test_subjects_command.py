"""``eskin subjects`` as its user has it: real files, and a cloud to fetch from."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import TYPE_CHECKING, Final

import pytest
from typer.testing import CliRunner

from eskin.cli import app
from eskin.identity import IdentityKind
from eskin.identity.identity import ROOT_FILE
from eskin.identity.tls import server_context
from eskin.privacy import open_keystore
from eskin.runtime.settings import KeysSection

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.identity import Identity
    from eskin.privacy import KeyStore
    from tests.support.identities import Identities

NAME: Final = "Grace Hopper"
CUT_OFF: Final = 10
"""Bytes that the third answer promises beside."""
LINES: Final = b'{"kind":"frame"}\n{"kind":"peak"}\n'


class Site:
    """A gateway's settings and key store."""

    def __init__(self, folder: Path) -> None:
        self.config = folder / "gateway.toml"
        self.config.write_text(
            f'[identity]\ndirectory = "{folder}"\nsite = "{folder}"\n'
            f'[spool]\npath = "{folder / "spool.db"}"\n'
        )
        self.folder = folder

    def run(self, *words: str, said: str = "", status: int = 0) -> str:
        wide = {"COLUMNS": "200"}
        arguments = ["subjects", *words, "--config", str(self.config)]
        done = CliRunner(env=wide).invoke(app, arguments, input=said)
        assert (done.exit_code != 0) == (status != 0), done.output
        return done.output + str(done.exception or "")

    @property
    def keystore(self) -> KeyStore:
        return open_keystore(KeysSection(), self.folder / "keys")


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


def test_person_is_assigned_listed_released_and_erased(site: Site) -> None:
    site.run("assign", "--node", "hand", said=f"{NAME}\n")
    (grace,) = site.keystore.named(NAME)
    (row,) = [line for line in site.run("list").splitlines() if NAME in line]
    assert row.split()[2:] == [grace.pseudonym, "hand", "sealed"]
    site.run("assign", "--node", "palm", "--name", NAME)
    assert site.keystore.named(NAME) == [grace]
    site.run("release", "--node", "palm")
    site.run("erase", said=f"{NAME}\n")
    listed = site.run("list")
    assert NAME not in listed
    (row,) = [line for line in listed.splitlines() if grace.pseudonym in line]
    assert "the cloud has not confirmed yet" in row
    assert "no such person" in site.run("erase", "--name", NAME, status=2)
    assert "its key is destroyed" in site.run("erase", "--pseudonym", grace.pseudonym, status=2)


def test_person_who_is_assigned_twice_at_once_is_one(site: Site) -> None:
    made: list[str] = []
    vaults = [site.keystore for _ in range(6)]
    threads = [
        threading.Thread(
            target=lambda keystore=keystore: made.append(keystore.person(NAME).pseudonym)
        )
        for keystore in vaults
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    assert len(made) == 6
    assert len(set(made)) == 1


def test_all_of_a_name_are_erased(site: Site) -> None:
    made = [site.keystore.create(NAME) for _ in range(2)]
    said = site.run("erase", "--name", NAME)
    assert site.keystore.named(NAME) == []
    for subject in made:
        assert f"{subject.pseudonym}: its key and name are destroyed here" in said


@pytest.mark.parametrize("name", ["", " ", "x" * 201])
def test_name_that_is_none_is_refused(site: Site, name: str) -> None:
    assert "--name" in site.run("assign", "--node", "hand", "--name", name, status=2)


@pytest.mark.parametrize("words", [("assign", "--node", "hand"), ("erase",)])
def test_no_name_is_asked_for_before_the_settings_are_read(words: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, ["subjects", *words, "--config", "/none.toml"], input="")
    assert "/none.toml" in str(done.exception)
    assert "Name" not in done.output


@contextmanager
def answering(
    own: Identity | None = None, lines: bytes = LINES
) -> Iterator[tuple[str, list[tuple[str, str | None]]]]:
    """A cloud that answers exports; over TLS if it has an identity."""
    asked: list[tuple[str, str | None]] = []

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append((self.path, self.headers["Authorization"]))
            allowed = self.headers["Authorization"] == "Bearer eskin_abc"
            self.send_response(200 if allowed else 403)
            self.send_header("Content-Length", str(len(lines) + CUT_OFF * (len(asked) == 3)))
            self.end_headers()
            self.wfile.write(lines)

        def log_message(self, *_: object) -> None:
            return

    with HTTPServer(("127.0.0.1", 0), Answers) as server:
        if own is not None:
            context = server_context(own.directory, client_certificates=False)
            server.socket = context.wrap_socket(server.socket, server_side=True)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http{'' if own is None else 's'}://127.0.0.1:{server.server_port}", asked
        server.shutdown()
        thread.join()


@pytest.fixture
def cloud() -> Iterator[tuple[str, list[tuple[str, str | None]]]]:
    with answering() as place:
        yield place


def test_export_asks_by_pseudonym_and_keeps_the_answer_for_its_owner_alone(
    site: Site, cloud: tuple[str, list[tuple[str, str | None]]]
) -> None:
    url, asked = cloud
    site.run("assign", "--node", "hand", "--name", NAME)
    (grace,) = site.keystore.named(NAME)
    token, out = site.folder / "token", site.folder / "out.jsonl"
    token.write_text("eskin_abc\n")
    words = ["--url", url, "--token", str(token), "--name", NAME, "--out"]
    site.run("export", *words, str(out))
    assert asked == [(f"/api/v1/subjects/{grace.pseudonym}/export", "Bearer eskin_abc")]
    assert out.read_bytes() == LINES
    assert out.stat().st_mode & 0o077 == 0


def test_cloud_of_our_own_ca_is_trusted_where_its_root_is_named(
    site: Site, identities: Identities
) -> None:
    site.run("assign", "--node", "hand", "--name", NAME)
    token, out = site.folder / "token", site.folder / "out.jsonl"
    token.write_text("eskin_abc\n")
    own = identities.make(IdentityKind.SERVER, "server.exports")
    with answering(own) as (url, asked):
        words = ["export", "--url", url, "--token", str(token), "--name", NAME, "--out", str(out)]
        assert "certificate" in site.run(*words, status=2)
        assert asked == []
        site.run(*words, "--root", str(own.directory / ROOT_FILE))
    assert out.read_bytes() == LINES


def test_export_names_what_is_damaged(site: Site) -> None:
    site.run("assign", "--node", "hand", "--name", NAME)
    token, out = site.folder / "token", site.folder / "out.jsonl"
    token.write_text("eskin_abc\n")
    lines = LINES + b'{"damaged":true,"node":"hand","boot":3,"sequence":7}\n' + LINES
    with answering(lines=lines) as (url, _):
        words = ["export", "--url", url, "--token", str(token), "--name", NAME, "--out", str(out)]
        said = site.run(*words, status=1)
    assert "hand boot 3 sequence 7" in said
    assert "4 lines" in said
    assert out.read_bytes() == lines


def test_all_of_a_name_are_exported(
    site: Site, cloud: tuple[str, list[tuple[str, str | None]]]
) -> None:
    url, asked = cloud
    made = {site.keystore.create(NAME).pseudonym for _ in range(2)}
    token, out = site.folder / "token", site.folder / "out.jsonl"
    token.write_text("eskin_abc\n")
    words = ["--url", url, "--token", str(token), "--name", NAME, "--out"]
    said = site.run("export", *words, str(out))
    assert {path for path, _ in asked} == {f"/api/v1/subjects/{each}/export" for each in made}
    assert out.read_bytes() == 2 * LINES
    assert all(each in said for each in made)


def test_refused_or_cut_off_export_leaves_no_file_and_may_be_repeated(
    site: Site, cloud: tuple[str, list[tuple[str, str | None]]]
) -> None:
    site.run("assign", "--node", "hand", "--name", NAME)
    token, out = site.folder / "token", site.folder / "out.jsonl"
    words = ["export", "--url", cloud[0], "--token", str(token), "--name", NAME]
    words += ["--out", str(out)]
    assert f"--token: {token} cannot be read" in site.run(*words, status=2)
    token.write_text("eskin_abc")
    site.run(*words)
    assert "--out" in site.run(*words, status=2), "a file that is there is not overwritten"
    assert out.read_bytes() == LINES
    out.unlink()
    assert "--url" in site.run(*words, status=2), "the third answer is cut off"
    token.write_text("eskin_wrong")
    assert "403" in site.run(*words, status=2)
    assert not out.exists()
    token.write_text("eskin_abc")
    site.run(*words)
    assert out.read_bytes() == LINES
