"""What a budget is made for: a profile, a settings file, or a packaged design of many nodes."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final, Self

from eskin.errors import SettingsError
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.settings import NodeSettings

if TYPE_CHECKING:
    from pathlib import Path

_SECONDS: Final = 20
_NOWHERE: Final[dict[str, Any]] = {
    "identity": {"directory": "none", "site": "none"},
    "flash": {"path": "none"},
    "truth": {"path": "none"},
}
"""A budget needs no network and keeps nothing."""


def design_names() -> list[str]:
    """Packaged profiles, and packaged designs of many nodes."""
    return sorted([*profile_names(), *_packaged()])


@dataclass(frozen=True, slots=True)
class Design:
    """Some nodes that are alike.

    Attributes:
        name: Of the profile, or of the node.
        description: One line for people.
        nodes: How many.
        settings: Of each.
        seconds: For how long it is best run.
    """

    name: str
    description: str
    nodes: int
    settings: NodeSettings
    seconds: int = _SECONDS

    @classmethod
    def named(cls, name: str) -> Self:
        """A packaged one.

        Raises:
            SettingsError: There is none of that name.
        """
        if name in _packaged():
            return cls._many(name)
        if name not in profile_names():
            raise SettingsError(
                "profile", f"{name!r} is not allowed; use one of {', '.join(design_names())}"
            )
        settings = _settings(name, {})
        return cls(name, Profile.read(name).description, 1, settings)

    @classmethod
    def read(cls, path: Path) -> Self:
        """That of a node's settings file.

        Raises:
            SettingsError: The file cannot be used.
        """
        settings = NodeSettings.load(path)
        own = settings.node
        return cls(own.name, own.description or own.profile, 1, settings)

    @classmethod
    def _many(cls, name: str) -> Self:
        text = (
            files("eskin_sensor_node.tools.budget")
            .joinpath("designs", f"{name}.toml")
            .read_text("utf-8")
        )
        tables = tomllib.loads(text)
        taxels = [tables["taxel"] | {"id": f"t{k:02d}"} for k in range(tables["taxels_a_node"])]
        given = {key: tables[key] for key in ("energy", "sampling", "broker")} | {"taxel": taxels}
        settings = _settings(name, given)
        return cls(name, tables["description"], tables["nodes"], settings, tables["seconds"])


def _packaged() -> list[str]:
    found = files("eskin_sensor_node.tools.budget").joinpath("designs").iterdir()
    return sorted(entry.name[:-5] for entry in found if entry.name.endswith(".toml"))


def _settings(name: str, given: dict[str, Any]) -> NodeSettings:
    node = {"name": name, "profile": name, "seed": 1}
    return NodeSettings(**_NOWHERE | given | {"node": node})
