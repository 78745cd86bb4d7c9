"""Packaged profiles: designs of nodes that a user can run, copy and change."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final, Self

from eskin.errors import SettingsError

_DESCRIPTION: Final = "description"
_SECTIONS: Final[tuple[str, ...]] = ("sampling", "machine", "energy", "skin")


def profile_names() -> list[str]:
    """Names of the packaged profiles."""
    found = files("eskin_sensor_node").joinpath("profiles").iterdir()
    return sorted(entry.name[:-5] for entry in found if entry.name.endswith(".toml"))


@dataclass(frozen=True, slots=True)
class Profile:
    """A design: one line of description, its taxels, and what else belongs to it.

    Attributes:
        name: Such as ``fingertip``.
        description: One line for people.
        taxels: The ``[[taxel]]`` tables; none where it has a skin.
        sections: Its ``[sampling]``, ``[machine]``, ``[energy]`` and ``[skin]``, where it has them.
        text: The same tables as TOML with their comments, ready to stand at the end of a node's
            file.
    """

    name: str
    description: str
    taxels: list[dict[str, Any]]
    sections: dict[str, dict[str, Any]]
    text: str

    @classmethod
    def read(cls, name: str) -> Self:
        """Read a packaged profile.

        Raises:
            SettingsError: There is none of that name.
        """
        if name not in profile_names():
            raise SettingsError(
                "node.profile", f"{name!r} is not allowed; use one of {', '.join(profile_names())}"
            )
        text = files("eskin_sensor_node").joinpath("profiles", f"{name}.toml").read_text("utf-8")
        tables = tomllib.loads(text)
        lines = [line for line in text.splitlines() if not line.startswith(f"{_DESCRIPTION} =")]
        sections = {key: tables[key] for key in _SECTIONS if key in tables}
        rest = "\n".join(lines).strip() + "\n"
        return cls(name, tables[_DESCRIPTION], tables.get("taxel", []), sections, rest)
