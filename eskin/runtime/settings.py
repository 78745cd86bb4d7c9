"""Settings of a process: one table of sections, from TOML and from the environment.

A setting ``port`` of section ``broker`` is written ``[broker] port = 8883`` in the file, or
``ESKIN_BROKER_PORT=8883`` in the environment, which wins. Unknown keys are refused.
"""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticUndefined
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)
from pydantic_settings import (
    SettingsError as EnvironmentSettingsError,
)

from eskin.errors import SettingsError, shown, unprefixed

if TYPE_CHECKING:
    from collections.abc import Iterator

ENVIRONMENT_PREFIX = "ESKIN_"
_LONGEST_NAME: Final = 200
_LONGEST_REASON: Final = 1000
"""Of a setting as errors show it: a name may be anything."""


Host = Annotated[str, Field(min_length=1, max_length=253)]
"""A name or an address (RFC 1035, section 2.3.4)."""


class Section(BaseModel):
    """One table of a configuration file; every field has a description."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RenewalSection(Section):
    """Who renews the process's certificates, and brings what else the CA says."""

    url: str = Field(
        default="",
        pattern=r"^(https://[^\s/@]+)?$",
        description="CA service that renews identities, and brings sites' certificates and "
        "revocation lists; empty: another process does",
    )
    every_s: float = Field(
        default=1.0, gt=0, le=86_400, description="seconds between two looks at the CA service"
    )


class KeysSection(Section):
    """Where the keys of subjects are: of persons with biometric channels."""

    directory: Path | None = Field(
        default=None,
        description="folder of the key store; without it `keys` beside a flash or a spool, and a "
        "cloud keeps sealed channels and shows none",
    )
    master: Path | None = Field(
        default=None,
        description="file (0600) with the master key, on another disk than the folder; without it "
        "`master.key` in the folder, which protects nothing from a thief of the disk",
    )
    module: Path | None = Field(
        default=None,
        description="PKCS#11 library of the hardware that holds the master key, in place of a file",
    )
    token: str = Field(
        default="eskin", min_length=1, max_length=32, description="label of the hardware's token"
    )
    pin: Path | None = Field(default=None, description="file (0600) that holds the token's PIN")


class LogSection(Section):
    """What is logged."""

    level: Annotated[
        Literal["DEBUG", "INFO", "WARNING", "ERROR"],
        BeforeValidator(lambda given: str(given).upper()),
    ] = Field(default="INFO", description="DEBUG, INFO, WARNING or ERROR")


class Settings(BaseSettings):
    """All settings of a process; its fields are `Section` classes."""

    model_config = SettingsConfigDict(
        extra="forbid",
        frozen=True,
        env_prefix=ENVIRONMENT_PREFIX,
        env_nested_delimiter="_",
        env_nested_max_split=1,
    )

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """The environment before the file, and nothing else."""
        del settings_cls, dotenv_settings, file_secret_settings
        return env_settings, init_settings

    @classmethod
    def load(cls, path: Path | None = None) -> Self:
        """Read the settings.

        Paths in the file are relative to its folder, so that a folder with settings and data can
        be moved.

        Args:
            path: TOML file; ``None`` takes defaults and environment only.

        Raises:
            SettingsError: The file cannot be read, or a setting is unknown or not allowed. It names
                the setting, the value, and what is allowed.
        """
        try:
            return cls(**({} if path is None else _located(cls, _read(path), path.parent)))
        except ValidationError as error:
            raise _refusal(cls, error, path) from error
        except (EnvironmentSettingsError, RecursionError) as error:
            raise _environment_refusal(error) from error


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of the table of settings.

    Attributes:
        name: Dotted name, such as ``broker.port``.
        default: As written in TOML; ``None`` where it must be given.
        help: One line: what it is, with its unit.
    """

    name: str
    default: str | None
    help: str

    @property
    def variable(self) -> str:
        """Its name in the environment."""
        return _variable(*self.name.split("."))


def table(settings: type[Settings]) -> Iterator[Setting]:
    """All settings of a process, in order of their declaration."""
    for section, field in settings.model_fields.items():
        model = field.annotation
        if isinstance(model, type) and issubclass(model, BaseModel):
            for name, inner in model.model_fields.items():
                yield Setting(f"{section}.{name}", _default(inner), inner.description or "")
        else:
            yield Setting(section, _default(field), field.description or "")


def _default(field: Any) -> str | None:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return None
    if isinstance(value, bool | tuple):
        return json.dumps(value)
    return str(value)


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise SettingsError("--config", f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        # Also integers of thousands of digits, and arrays in arrays in arrays.
        raise SettingsError("--config", f"{path} is no TOML that can be read: {error}") from error


def _located(settings: type[Settings], data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What a file says, with its relative paths below its folder."""
    for section, field in settings.model_fields.items():
        model, values = field.annotation, data.get(section)
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            continue
        if not isinstance(values, dict):
            continue
        for name, inner in model.model_fields.items():
            kinds = get_args(inner.annotation) or (inner.annotation,)
            if Path in kinds and isinstance(values.get(name), str):
                values[name] = folder / values[name]
    return data


def _variable(*name: object) -> str:
    """Name in the environment of a section, or of a setting in it."""
    return ENVIRONMENT_PREFIX + "_".join(map(str, name[:2])).upper()


def _places(loc: tuple[int | str, ...], path: Path | None) -> list[str]:
    """Where a setting, or a section, may come from: environment variables, else also the file.

    A variable that has all of a section as JSON adds to what the file says of it.
    """
    own, section = _variable(*loc), _variable(*loc[:1])
    given = {name.upper(): name for name in os.environ}
    if own in given:
        return [f"environment variable {given[own]}"]
    parts = f"{section}_" if len(loc) == 1 else None
    found = [
        f"environment variable {name}"
        for upper, name in given.items()
        if upper == section or (parts is not None and upper.startswith(parts))
    ]
    return found if path is None else [f"file {path}", *found]


def _refusal(settings: type[Settings], error: ValidationError, path: Path | None) -> SettingsError:
    first = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in first["loc"])[:_LONGEST_NAME] or "settings"
    places = ", ".join(_places(first["loc"], path))
    where = f" ({places})" if places else ""
    kind = settings.__name__.removesuffix("Settings").lower()
    if first["type"] == "missing":
        return SettingsError(
            name,
            f"is missing{where}; it has no default: set it, or choose a file with {kind} settings",
        )
    if first["type"] == "extra_forbidden":
        return SettingsError(
            name, f"no such setting{where} among {kind} settings; check its spelling"
        )
    why = unprefixed(first["msg"])[:_LONGEST_REASON]
    if first["type"] == "union_tag_invalid":  # which quotes the whole tag
        found = first["ctx"]
        why = f"{found['discriminator']} is one of {found['expected_tags']}"
    return SettingsError(name, f"{shown(first['input'])} is not allowed{where}: {why}")


def _environment_refusal(error: Exception) -> SettingsError:
    fault = error.__cause__
    if not isinstance(fault, json.JSONDecodeError):
        return SettingsError("environment", str(error))
    names = [
        name
        for name, value in os.environ.items()
        if value == fault.doc and name.upper().startswith(ENVIRONMENT_PREFIX)
    ]
    return SettingsError(
        " or ".join(names)[:_LONGEST_NAME] or "environment",
        f"{shown(fault.doc)} is no JSON: {fault}; write a list as [...], a section as {{...}}",
    )
