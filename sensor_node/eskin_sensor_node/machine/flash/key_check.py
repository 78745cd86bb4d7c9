"""The proof that a flash is opened under the key which sealed it: a row that this key opens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Iterable
    from pathlib import Path

    from eskin_sensor_node.machine.flash.sealing import Row, Sealing

PROOF: Final = """CREATE TABLE IF NOT EXISTS proof (
    one INTEGER PRIMARY KEY CHECK (one = 1),
    body BLOB NOT NULL
) STRICT"""
_WHAT: Final = "proof"


def require_key(
    db: sqlite3.Connection, path: Path, own: Sealing, records: Iterable[tuple[Sealing, Row]]
) -> None:
    """See that the key is the one that sealed what is here.

    Where the row is missing, or is what was damaged, any record proves it as well.

    Args:
        db: The file.
        path: Where it is.
        own: Seals for whoever owns the file.
        records: All, each with what opens it.

    Raises:
        FlashError: It is another key.
        sqlite3.Error: The file cannot be read or written.
    """
    proof = db.execute("SELECT body FROM proof").fetchone()
    if proof is not None and own.open_last(_WHAT, proof[0]) is not None:
        return
    sealed = proof is not None
    for sealing, row in records:
        sealed = True
        if sealing.open(row) is not None:
            break
    else:
        if sealed:
            raise FlashError(
                f"{path}: flash is sealed under another key, or for another node; bring back the "
                "key store of keys.directory, or choose another flash.path"
            )
    db.execute("INSERT OR REPLACE INTO proof VALUES (1, ?)", (own.seal_last(_WHAT, b""),))
