"""Configuration by the environment."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError
from eskin.runtime.settings import table
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target
from tests.robustness.fuzz.targets.settings import CLASSES, FILES, bare_environment, require_line

if TYPE_CHECKING:
    from pathlib import Path


_MOST: Final = 12
_LONGEST: Final = 2048
"""Bytes of an input: twelve variables with long values."""


def make(folder: Path) -> Target:
    """The input is the number of a process, and lines ``NAME=value`` over its good file."""
    paths = []
    for number, text in enumerate(FILES):
        paths.append(folder / f"{number}.toml")
        paths[-1].write_text(text)

    def check(data: bytes) -> None:
        number = sum(data[:1]) % len(CLASSES)
        lines = data[1:].replace(b"\x00", b"").split(b"\n")[:_MOST]
        pairs = (line.partition(b"=") for line in lines)
        given = {name: value for name, _, value in pairs if name.startswith(b"ESKIN_")}
        os.environb.update(given)
        try:
            CLASSES[number].load(paths[number])
        except SettingsError as error:
            require_line(str(error))
        finally:
            for name in given:
                del os.environb[name]

    seeds = []
    for number, settings in enumerate(CLASSES):
        lines = [f"{row.variable}={row.default or 'x'}" for row in table(settings)]
        short = ["ESKIN_BROKER_PORT=1883", "ESKIN_TAXEL=[]", 'ESKIN_NODE={"name": "x"}']
        texts = ["\n".join(lines[k : k + 4]) for k in range(0, len(lines), 4)]
        seeds += [f"{number}{text}".encode() for text in (*texts, *short)]
    return Target(tuple(seeds), mutate_text, check, bare_environment(), _LONGEST)
