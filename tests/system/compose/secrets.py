"""Finds what must not be in an image."""

from __future__ import annotations

import re
import tarfile
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# At the start of a line and with the key itself: libraries hold the words, and keys of self-tests.
_KEY: Final = re.compile(rb"(?m)^-----BEGIN (?:[A-Z]+ )*PRIVATE KEY-----\s+[A-Za-z0-9+/=]{32}")
_NAMES: Final = re.compile(r"(^|/)(key\.pem|[^/]*\.(key|token|sqlite))$")


def secrets_in(saved: Path) -> Iterator[str]:
    """Names of files with a private key, a token or data in the layers of saved images.

    Args:
        saved: As ``docker save`` writes it; layers also hold what a later one removed.
    """
    with tarfile.open(saved) as images:
        for layer in images:
            content = images.extractfile(layer)
            if content is None or not layer.isfile() or layer.name.endswith(".json"):
                continue
            try:
                with tarfile.open(fileobj=content) as files:
                    yield from _in_layer(files)
            except tarfile.ReadError:
                continue  # the engine's own notes


def _in_layer(files: tarfile.TarFile) -> Iterator[str]:
    for member in files:
        content = files.extractfile(member) if member.isfile() else None
        if content is not None and (_NAMES.search(member.name) or _KEY.search(content.read())):
            yield member.name
