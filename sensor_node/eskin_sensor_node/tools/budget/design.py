"""What a budget is made for: a packaged profile, or a settings file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

from eskin.errors import SettingsError
from eskin.wire.messages import Mode
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.settings import NodeSettings

if TYPE_CHECKING:
    from pathlib import Path

SECONDS: Final = 20
"""For how long a design is best run: as long as the packaged scenarios."""
MODES: Final = (str(Mode.SAMPLES), str(Mode.ADAPTIVE), str(Mode.PEAKS))
_NOWHERE: Final[dict[str, Any]] = {
    "identity": {"directory": "none", "site": "none"},
    "flash": {"path": "none"},
    "truth": {"path": "none"},
}
"""A budget needs no network and keeps nothing."""


@dataclass(frozen=True, slots=True)
class NodeDesign:
    """A node.

    Attributes:
        name: Of the profile, or of the node.
        description: One line for people.
        settings: Its settings.
    """

    name: str
    description: str
    settings: NodeSettings

    @classmethod
    def named(cls, name: str) -> Self:
        """A packaged profile.

        Raises:
            SettingsError: There is none of that name.
        """
        if name not in profile_names():
            raise SettingsError(
                "profile", f"{name!r} is not allowed; use one of {', '.join(profile_names())}"
            )
        node = {"name": name, "profile": name, "seed": 1}
        return cls(name, Profile.read(name).description, NodeSettings(**_NOWHERE | {"node": node}))

    @classmethod
    def read(cls, path: Path) -> Self:
        """That of a node's settings file.

        Raises:
            SettingsError: The file cannot be used.
        """
        settings = NodeSettings.load(path)
        own = settings.node
        return cls(own.name, own.description or own.profile, settings)

    @property
    def taxels(self) -> int:
        """How many the node samples."""
        return self.settings.skin.taxels if self.settings.skin.present else len(self.settings.taxel)

    @property
    def modes(self) -> tuple[str, ...]:
        """In which it can be run, the first one without any saving; a skin sends all samples."""
        return MODES[:1] if self.settings.skin.present else MODES
