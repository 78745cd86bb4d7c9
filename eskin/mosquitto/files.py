"""The files that Mosquitto reads anew on SIGHUP."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.identity.crl import revoked_serials
from eskin.identity.identity import CHAIN_FILE
from eskin.mosquitto.configuration import KINDS
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.runtime.files.stamp import Version


def versions(*, identity: Path, anchors: Path) -> tuple[Version, ...]:
    """Their versions: others once one of the files was replaced.

    Args:
        identity: Folder of the broker's identity.
        anchors: Folder with ``KIND.anchor.pem`` and ``KIND.crl.pem``.

    Raises:
        OSError: One cannot be looked at.
    """
    ends = (".anchor.pem", ".crl.pem")
    files = [anchors / f"{kind}{end}" for kind in KINDS for end in ends]
    return tuple(version(file) for file in (identity / CHAIN_FILE, *files))


def revoked(anchors: Path) -> set[str]:
    """Serial numbers of the certificates that Mosquitto refuses by its revocation lists.

    Raises:
        OSError: A list cannot be read.
        ValueError: A list cannot be parsed.
    """
    lists = [anchors / f"{kind}.crl.pem" for kind in KINDS]
    return {serial for file in lists for serial in revoked_serials(file.read_bytes())}
