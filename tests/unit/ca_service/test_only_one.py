"""One process at a time serves a CA, as it alone knows which tokens are used."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_ca.service import run
from eskin_ca.settings import CaSection, CaSettings
from eskin_ca.tokens import TOKENS_FILE

from eskin.errors import IdentityError
from eskin.runtime.files.lock import LockFile
from tests.support.processes import free_port

if TYPE_CHECKING:
    from pathlib import Path


def test_second_service_on_one_folder_is_refused(tmp_path: Path) -> None:
    own = CaSection(directory=tmp_path / "ca", port=free_port())
    with (
        LockFile(own.directory / TOKENS_FILE),
        pytest.raises(IdentityError, match="another CA service runs on this folder; stop it"),
    ):
        run(CaSettings(ca=own))
