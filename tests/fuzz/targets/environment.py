"""Configuration by the environment."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from eskin.errors import SettingsError
from eskin.settings import table
from tests.fuzz.mutations.texts import mutate_text
from tests.fuzz.target import Target
from tests.fuzz.targets.settings import CLASSES, FILES, require_line

if TYPE_CHECKING:
    from pathlib import Path


_MOST = 12


def make(folder: Path) -> Target:
    """The input is lines ``NAME=value``, for each process over a good file."""
    paths = []
    for number, text in enumerate(FILES):
        paths.append(folder / f"{number}.toml")
        paths[-1].write_text(text)

    def check(data: bytes) -> None:
        pairs = (line.partition(b"=") for line in data.replace(b"\x00", b"").split(b"\n")[:_MOST])
        given = {name: value for name, _, value in pairs if name.startswith(b"ESKIN_")}
        os.environb.update(given)
        try:
            for settings, path in zip(CLASSES, paths, strict=True):
                try:
                    settings.load(path)
                except SettingsError as error:
                    require_line(str(error))
        finally:
            for name in given:
                del os.environb[name]

    rows = [row for settings in CLASSES for row in table(settings)]
    lines = [f"{row.variable}={row.default or 'x'}" for row in rows]
    seeds = ["\n".join(lines[k : k + 4]) for k in range(0, len(lines), 4)]
    short = ["ESKIN_BROKER_PORT=1883", "ESKIN_TAXEL=[]", 'ESKIN_NODE={"name": "x"}']
    return Target(tuple(seed.encode() for seed in (*seeds, *short)), mutate_text, check)
