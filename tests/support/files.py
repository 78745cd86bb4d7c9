"""Files of the processes that tests start: settings to write, databases to look into."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


_PLAIN: Final = bool | int | float | list


def write_settings(path: Path, sections: Mapping[str, Mapping[str, object]]) -> Path:
    """Write a TOML file of a process's settings."""
    lines = []
    for section, values in sections.items():
        lines.append(f"[{section}]")
        lines += [
            # A JSON string is a TOML basic string, and a list of them an array.
            f"{key} = {json.dumps(value if isinstance(value, _PLAIN) else str(value))}"
            for key, value in values.items()
        ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def ask(path: Path, query: str) -> list[tuple[Any, ...]]:
    """Ask a SQLite database that another may write; nothing where there is none yet."""
    if not path.exists():
        return []
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=30)) as database:
        return database.execute(query).fetchall()
