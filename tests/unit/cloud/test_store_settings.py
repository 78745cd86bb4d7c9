"""Settings of the store's location and password."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.settings import CloudSettings
from eskin_cloud.store import Store
from eskin_cloud.store.postgres import driver_arguments

from eskin.errors import SettingsError, StoreError
from tests.support.files import write_settings
from tests.unit.cloud.clouds import Clock
from tests.unit.cloud.messages import START

if TYPE_CHECKING:
    from collections.abc import Mapping


@pytest.mark.parametrize(
    ("store", "setting", "said"),
    [
        ({}, "store.path", "is missing"),
        ({"url": "postgresql://u@h/d", "path": "x"}, "store.path", "beside store.url"),
        ({"url": "postgresql://u@db.example/d"}, "store.root", "plaintext stays on loopback"),
        (
            {"url": "postgresql://u@/d?host=localhost:5432&host=db.example:5432"},
            "store.root",
            "plaintext stays on loopback",
        ),
        ({"url": "postgresql://u:secret@localhost/d"}, "store.url", "store.password_file"),
        ({"url": "mysql://u@localhost/d"}, "store.url", "postgresql://USER@HOST"),
        ({"url": "postgresql:///d"}, "store.url", "postgresql://USER@HOST"),
        ({"url": "postgresql://u@localhost/d?sslmode=disable"}, "store.url", "only host is"),
    ],
)
def test_bad_setting_is_named(
    tmp_path: Path, store: dict[str, str], setting: str, said: str
) -> None:
    with pytest.raises(SettingsError, match=said) as refused:
        _load(tmp_path, store)
    assert refused.value.setting == setting


def test_several_servers_on_loopback_need_no_root(tmp_path: Path) -> None:
    url = "postgresql://u@/d?host=localhost:5432&host=127.0.0.1:5433"
    place = _load(tmp_path, {"url": url}).store.place
    assert not isinstance(place, Path)
    words = driver_arguments(place)
    assert (words["host"], words["port"]) == ("localhost,127.0.0.1", "5432,5433")


def test_password_comes_from_its_file_and_is_never_shown(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("s3cret\n")
    asked = {"url": "postgresql://u@db.example:5433/d", "password_file": file, "root": "root.pem"}
    place = _load(tmp_path, asked).store.place
    assert not isinstance(place, Path)
    assert place.password == file.read_text().strip()
    assert place.query == {"sslmode": "verify-full", "sslrootcert": str(tmp_path / "root.pem")}
    with pytest.raises(StoreError) as refused:
        Store(place.set(host="localhost", port=1, query={}), clock=Clock(START))
    assert "s3cret" not in str(refused.value)
    assert "start it, or correct store.url" in str(refused.value)
    file.write_text("")
    with pytest.raises(SettingsError, match="is empty"):
        _ = _load(tmp_path, asked).store.place


def _load(folder: Path, store: Mapping[str, object]) -> CloudSettings:
    sections = {"store": store, "gateways": {"identity": "i"}}
    return CloudSettings.load(write_settings(folder / "cloud.toml", sections))
