"""One flipped bit: where it may be, and whose it is."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from random import Random

_MAGIC: Final = b"SQLite format 3\0"
_HEADER: Final = "header"
_ANYWHERE: Final = 0.1


class Place(NamedTuple):
    """A stretch of a file that belongs together.

    Attributes:
        file: Relative to the part's folder.
        table: Table or index of a database; empty in other files.
        begin: First byte.
        end: Behind the last one.
    """

    file: str
    table: str
    begin: int
    end: int

    def __str__(self) -> str:
        return f"{self.file} {self.table}".rstrip()


class Flip(NamedTuple):
    """A bit of a place.

    Attributes:
        place: Where it is.
        at: Its byte in the file.
        bit: Its bit in that byte.
    """

    place: Place
    at: int
    bit: int

    def __str__(self) -> str:
        return f"{self.place} byte {self.at} bit {self.bit}"

    def apply(self, folder: Path) -> None:
        """Flip it in a copy of the part's folder."""
        path = folder / self.place.file
        data = bytearray(path.read_bytes())
        data[self.at] ^= 1 << self.bit
        path.write_bytes(data)


def draw(folder: Path, patterns: Sequence[str], random: Random, tables: Sequence[str] = ()) -> Flip:
    """Draw a flip: each file as likely as each other, and of a database each of its trees.

    Bytes that are zero are passed by where there are others: most of them are free space. If tables
    are given, only their trees and those of their indexes are drawn from.
    """
    files = sorted({path for pattern in patterns for path in folder.glob(pattern)})
    places = [place for path in files if path.is_file() for place in _places(folder, path, tables)]
    chosen = random.choice(sorted({str(place) for place in places}))
    place = random.choice([each for each in places if str(each) == chosen])
    data = (folder / place.file).read_bytes()
    written = [at for at in range(place.begin, place.end) if data[at]]
    anywhere = random.random() < _ANYWHERE or not written
    at = random.randrange(place.begin, place.end) if anywhere else random.choice(written)
    return Flip(place, at, random.randrange(8))


def _places(folder: Path, path: Path, tables: Sequence[str]) -> list[Place]:
    data = path.read_bytes()
    if data.startswith(_MAGIC):
        return _trees(folder, path, tables)
    if tables:
        return []
    return [Place(str(path.relative_to(folder)), "", 0, len(data))] if data else []


def _trees(folder: Path, path: Path, tables: Sequence[str]) -> list[Place]:
    """The pages of each table and index that holds a row; of all tables where none is given."""
    file = str(path.relative_to(folder))
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        size = db.execute("PRAGMA page_size").fetchone()[0]
        query = """
            SELECT s.name, pageno, tbl_name FROM dbstat AS s
            LEFT JOIN sqlite_schema AS m ON m.name = s.name WHERE ncell > 0
        """
        pages = db.execute(query).fetchall()
    places = [
        Place(file, name, size * (page - 1), size * page)
        for name, page, table in pages
        if not tables or table in tables
    ]
    return places if tables else [Place(file, _HEADER, 0, 100), *places]
