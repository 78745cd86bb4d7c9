"""One process owns a file, and its end, however it comes, lets go."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from eskin.errors import LockedError
from eskin.lockfile import LockFile

if TYPE_CHECKING:
    from pathlib import Path

HOLD = """
import sys, time
from pathlib import Path
from eskin.lockfile import LockFile
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
