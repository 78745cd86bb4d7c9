"""One process owns a file, and its end, however it comes, lets go."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from eskin.errors import LockedError
from eskin.runtime.files.lock import LockFile

if TYPE_CHECKING:
    from pathlib import Path

HOLD = """
import sys, time
from pathlib import Path
from eskin.runtime.files.lock import LockFile
owner = LockFile(Path(sys.argv[1]))
print("owned", flush=True)
time.sleep(60)
"""


def test_second_owner_is_refused_until_the_first_lets_go(tmp_path: Path) -> None:
    with LockFile(tmp_path / "new" / "spool"):
        with pytest.raises(LockedError, match="another process uses it") as refused:
            LockFile(tmp_path / "new" / "spool")
        assert refused.value.path == tmp_path / "new" / "spool"
        LockFile(tmp_path / "new" / "other").close()
    LockFile(tmp_path / "new" / "spool").close()


def test_killed_owner_leaves_nothing_locked(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True
    ) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "owned\n"
        with pytest.raises(LockedError):
            LockFile(path)
        owner.kill()
        owner.wait()
    LockFile(path).close()


def test_lock_that_root_makes_is_the_folders_owners_and_no_other_file_is_given_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[int, int, int]] = []

    def give(descriptor: int, user: int, group: int) -> None:
        given.append((os.fstat(descriptor).st_ino, user, group))

    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "fchown", give)
    (tmp_path / "precious").touch()
    (tmp_path / "linked.lock").symlink_to(tmp_path / "precious")
    for _ in range(2):
        LockFile(tmp_path / "spool").close()
        LockFile(tmp_path / "linked").close()
    folder, lock = tmp_path.stat(), (tmp_path / "spool.lock").stat()
    assert given == [(lock.st_ino, folder.st_uid, folder.st_gid)]


def test_lock_that_an_ordinary_user_makes_is_his(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(os, "fchown", None)
    LockFile(tmp_path / "spool").close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")
def test_user_goes_on_where_root_was_first(tmp_path: Path) -> None:
    folder = tmp_path / "of-a-user"
    folder.mkdir()
    os.chown(folder, 65534, 65534)
    LockFile(folder / "spool").close()
    found = (folder / "spool.lock").stat()
    assert (found.st_uid, found.st_gid, found.st_mode & 0o777) == (65534, 65534, 0o600)
