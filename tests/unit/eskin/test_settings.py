"""Settings come from file and environment; what is wrong is named with value and remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import pytest
from pydantic import Field, model_validator

from eskin.errors import SettingsError
from eskin.runtime.settings import Section, Settings, table

if TYPE_CHECKING:
    from pathlib import Path


class BrokerSection(Section):
    host: str = Field(default="127.0.0.1", description="broker's name")
    port: int = Field(description="broker's port", ge=1, le=65535)
    keep_alive_s: float = Field(default=10.0, gt=0, description="keep alive, in s")
    names: tuple[str, ...] = Field(default=(), description="further names")

    @model_validator(mode="after")
    def _is_ours(self) -> Self:
        if self.host == "refused":
            raise ValueError("no broker of ours")
        return self


class ExampleSettings(Settings):
    broker: BrokerSection


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "example.toml"
    path.write_text(text)
    return path


def test_file_gives_values_and_defaults_fill_in(tmp_path: Path) -> None:
    settings = ExampleSettings.load(write(tmp_path, "[broker]\nport = 8883\n"))
    assert settings.broker == BrokerSection(port=8883)


def test_environment_wins_over_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ESKIN_BROKER_PORT", "1234")
    monkeypatch.setenv("ESKIN_BROKER_KEEP_ALIVE_S", "2.5")
    settings = ExampleSettings.load(write(tmp_path, '[broker]\nport = 8883\nhost = "b"\n'))
    assert settings.broker == BrokerSection(host="b", port=1234, keep_alive_s=2.5)


def test_environment_alone_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ESKIN_BROKER_PORT", "1234")
    assert ExampleSettings.load().broker.port == 1234


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[broker]\nport = 0\n", r"broker\.port: 0 is not allowed .*greater than or equal to 1"),
        ('[broker]\nport = "x"\n', r"broker\.port: 'x' is not allowed .*valid integer"),
        ("[broker]\n", r"broker\.port: is missing .*no default"),
        ("", r"broker: is missing"),
        ("[broker]\nport = 1\nprot = 2\n", r"broker\.prot: no such setting .*spelling"),
        ("[brocker]\nport = 1\n", r"broker: is missing|brocker: no such"),
        ("[broker]\nport = 1\nkeep_alive_s = nan\n", r"keep_alive_s: nan is not allowed"),
        ("[broker\n", "is no TOML"),
    ],
)
def test_wrong_setting_is_named_with_value_and_remedy(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(SettingsError, match=words):
        ExampleSettings.load(write(tmp_path, text))


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("ESKIN_BROKER_PORT", "many", r"broker\.port: 'many' is not allowed .*ESKIN_BROKER_PORT"),
        ("eskin_broker_port", "many", r"broker\.port: 'many' is not allowed .*eskin_broker_port"),
        ("ESKIN_BROKER_PROT", "1", r"broker\.prot: no such setting .*ESKIN_BROKER_PROT"),
        ("ESKIN_BROKER_NAMES", "many", r"ESKIN_BROKER_NAMES: 'many' is no JSON"),
        ("ESKIN_BROKER", "[1]", r"broker: \[1\] is not allowed .*ESKIN_BROKER"),
    ],
)
def test_wrong_environment_is_named_and_the_file_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, value: str, words: str
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(SettingsError, match=words) as caught:
        ExampleSettings.load(write(tmp_path, "[broker]\nport = 1\n"))
    assert "example.toml" not in str(caught.value)


def test_wrong_part_of_a_file_is_not_blamed_on_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ESKIN_BROKER_HOST", "b")
    with pytest.raises(SettingsError, match=r"broker\.port: 'x' is .*example\.toml") as caught:
        ExampleSettings.load(write(tmp_path, '[broker]\nport = "x"\n'))
    assert "ESKIN_BROKER" not in str(caught.value)


def test_section_of_file_and_environment_names_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ESKIN_BROKER_HOST", "refused")
    with pytest.raises(
        SettingsError, match=r"broker: .*example\.toml, .*ESKIN_BROKER_HOST"
    ) as caught:
        ExampleSettings.load(write(tmp_path, "[broker]\nport = 1\n"))
    assert "no broker of ours" in str(caught.value)
    assert "Value error" not in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"absent\.toml cannot be read: No such file"):
        ExampleSettings.load(tmp_path / "absent.toml")


def test_table_lists_every_setting_with_its_help_and_variable() -> None:
    rows = {setting.name: setting for setting in table(ExampleSettings)}
    assert list(rows) == ["broker.host", "broker.port", "broker.keep_alive_s", "broker.names"]
    assert rows["broker.port"].default is None
    assert rows["broker.keep_alive_s"].default == "10.0"
    assert rows["broker.keep_alive_s"].variable == "ESKIN_BROKER_KEEP_ALIVE_S"
    assert all(setting.help for setting in rows.values())
