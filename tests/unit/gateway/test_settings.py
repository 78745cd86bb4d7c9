"""Settings that would be unsafe are refused by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.service import Gateway
from eskin_gateway.settings import GatewaySettings

from eskin.errors import SettingsError
from eskin.runtime.settings import table

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities

_NEEDED = {"identity": {"directory": "/i", "site": "/s"}, "spool": {"path": "/p"}}


@pytest.mark.parametrize(
    ("section", "name", "value"),
    [
        ("http", "host", "0.0.0.0"),  # noqa: S104 - to be refused
        ("http", "host", "example.org"),
        ("cloud", "url", "http://localhost/api/v1/ingest"),
        ("cloud", "url", "https://user:secret@localhost/"),
        ("broker", "protocol", "4"),
        ("broker", "group", "a/b"),
        ("spool", "capacity_bytes", "1000"),
        ("broker", "colour", "red"),
    ],
)
def test_setting_that_is_not_allowed_is_named(
    tmp_path: Path, section: str, name: str, value: str
) -> None:
    sections: dict[str, dict[str, str]] = {key: dict(values) for key, values in _NEEDED.items()}
    sections.setdefault(section, {})[name] = value
    file = tmp_path / "gateway.toml"
    file.write_text(
        "".join(
            f"[{key}]\n" + "".join(f'{k} = "{v}"\n' for k, v in values.items())
            for key, values in sections.items()
        )
    )
    with pytest.raises(SettingsError) as caught:
        GatewaySettings.load(file)
    assert caught.value.setting == f"{section}.{name}"


def test_every_setting_has_a_description() -> None:
    assert all(setting.help for setting in table(GatewaySettings))


def test_identity_of_other_kind_is_rejected(settings: GatewaySettings, node_folder: Path) -> None:
    wrong = settings.identity.model_copy(update={"site": node_folder})
    with pytest.raises(SettingsError, match="holds a node; a site is needed"):
        Gateway(settings.model_copy(update={"identity": wrong}))


@pytest.fixture
def node_folder(identities: Identities) -> Path:
    return identities.node.directory
