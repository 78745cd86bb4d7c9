"""Which name was enrolled for which key: a file that only grows."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from eskin.errors import IdentityError
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.append_log import append_lines, whole_lines

if TYPE_CHECKING:
    from pathlib import Path


class TokenUses:
    """Names of fleets that were enrolled, each with the SHA-256 of its public key.

    Args:
        path: The file, which need not be there yet.

    Raises:
        IdentityError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._keys: dict[str, str] = {}
        if not path.exists():
            return
        try:
            for line in whole_lines(path.read_bytes()):
                use = without_check(json.loads(line))
                self._keys[use["name"]] = use["key"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise IdentityError(
                f"{path}: enrolled names cannot be read: {error}; bring the file back from a backup"
            ) from error

    def key(self, name: str) -> str | None:
        """The key for which a name was enrolled; ``None`` if it was not."""
        return self._keys.get(name)

    def bind(self, name: str, key: str) -> None:
        """Enrol a name for a key, durably.

        Raises:
            OSError: It cannot be written.
        """
        if self._keys.get(name) == key:
            return
        append_lines(self._path, json.dumps(with_check({"name": name, "key": key})) + "\n")
        self._keys[name] = key
