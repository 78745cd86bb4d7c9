"""Files that root makes belong to the folder's owner, and writers replace files atomically."""

from __future__ import annotations

import os
from threading import Thread
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from eskin.cli.pki import pki
from eskin.identity import IdentityKind, RootRotation
from eskin.identity.identity import write_whole
from eskin.runtime.files.atomic import write_private
from eskin.runtime.files.create import make_folder
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

NODE = IdentityKind.NODE
FOREIGN_UID = 65534
SIZE = 200_000


def test_whatever_root_makes_is_given_to_the_folders_owner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[int, tuple[int, int]] = {}

    def give(descriptor: int, user: int, group: int) -> None:
        given[os.fstat(descriptor).st_ino] = user, group

    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "fchown", give)
    own = Identities(tmp_path)
    own.authority.rotate(NODE)
    own.authority.revoke("fingertip")
    own.authority.retire(NODE)
    RootRotation(own.authority).begin()
    make_folder(tmp_path / "keys" / "nodes")
    write_private(tmp_path / "keys" / "nodes" / "palm", b"[]")
    made = list(tmp_path.rglob("*"))
    assert len(made) > 30
    for path in made:
        above = path.parent.stat()
        assert given[path.stat().st_ino] == (above.st_uid, above.st_gid), path


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")
def test_ca_that_root_rotates_stays_its_users(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    for path in (own.ca, *own.ca.rglob("*")):
        os.chown(path, FOREIGN_UID, FOREIGN_UID)
    for command in (
        ["rotate", "--kind", "node"],
        [
            *("issue", "--kind", "node", "--name", "palm", "--site", "site.main"),
            *("--out", str(own.ca / "palm")),
        ],
        ["revoke", "--name", "fingertip"],
        ["retire", "--kind", "node", "--force"],
        ["rotate", "--root"],
        ["sign"],
    ):
        done = CliRunner().invoke(pki, [*command, "--dir", str(own.ca)])
        assert done.exit_code == 0, done.output
    assert {path.name for path in own.ca.rglob("*") if path.stat().st_uid != FOREIGN_UID} == set()


def test_file_that_several_replace_at_once_is_always_whole(tmp_path: Path) -> None:
    path = tmp_path / "list"
    write_whole(path, b"0" * SIZE)
    faults: list[OSError] = []

    def replace(letter: bytes) -> None:
        try:
            for _ in range(40):
                write_whole(path, letter * SIZE)
        except OSError as error:
            faults.append(error)

    writers = [Thread(target=replace, args=(letter,)) for letter in (b"1", b"2", b"3")]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        content = path.read_bytes()
        assert content == content[:1] * SIZE
    assert faults == []
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_given_is_not_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "fchown", refuse)
    with pytest.raises(PermissionError):
        write_whole(tmp_path / "list", b"")
    assert list(tmp_path.iterdir()) == []
