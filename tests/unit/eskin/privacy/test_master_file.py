"""A master key in a file: where it lies, and a warning where that protects nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.errors import PrivacyError
from eskin.privacy import open_key, open_keystore
from eskin.runtime.settings import KeysSection

if TYPE_CHECKING:
    from pathlib import Path


def test_master_key_lies_where_the_settings_say(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data, other = tmp_path / "data", tmp_path / "other"
    data.mkdir()
    other.mkdir()
    apart = KeysSection(master=other / "master.key")
    made = open_keystore(apart, data / "keys").create("Ada")
    assert (other / "master.key").stat().st_mode & 0o777 == 0o600
    assert not list(data.rglob("master.key"))
    assert open_keystore(apart, data / "keys").find(made.pseudonym).key == made.key
    assert not caplog.records
    with pytest.raises(PrivacyError):
        open_keystore(KeysSection(), data / "keys").find(made.pseudonym)


@pytest.mark.parametrize("beside", [None, "keys/master.key", "master.key"])
def test_master_key_beside_the_data_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, beside: str | None
) -> None:
    master = None if beside is None else tmp_path / beside
    open_key(KeysSection(master=master), tmp_path / "keys", "hand.flash")
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "protects nothing" in caplog.text
