"""``eskin backup``: consistent copies of what a running system keeps."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Annotated, Final

import typer

from eskin.errors import SettingsError

Sources = Annotated[
    list[str],
    typer.Argument(help="Folders, SQLite files, or PostgreSQL servers (postgresql://...)."),
]
Out = Annotated[Path, typer.Option(help="Folder for the copies; it must not be there yet.")]

_MAGIC: Final = b"SQLite format 3\0"
_BESIDE: Final = ("-wal", "-shm", "-journal", ".lock", ".reserve")
"""Files beside a database that belong to the running process."""


def backup(sources: Sources, out: Out) -> None:
    """Copy folders and databases while they are in use; each becomes a part of --out."""
    names = [_name(source) for source in sources]
    if len(set(names)) < len(names):
        raise SettingsError("sources", f"two have one name: {', '.join(sorted(names))}")
    try:
        out.mkdir(mode=0o700, parents=True)
    except OSError as error:
        raise SettingsError("--out", f"{out}: {error.strerror}; name a new folder") from error
    for source, name in zip(sources, names, strict=True):
        if source.startswith("postgresql"):
            _dump(source, out / f"{name}.dump")
        else:
            copy(Path(source), out / name)
        typer.echo(f"copied: source={name} to={out}")


def copy(source: Path, target: Path) -> None:
    """Copy a folder or a file; SQLite databases consistently, also during writes.

    Files are readable by their owner alone. The journals, locks and reserves beside databases are
    left out: a database's copy holds all that was committed when it was taken.

    Raises:
        SettingsError: The source cannot be read, or the copy of a database is damaged.
    """
    try:
        if source.is_dir():
            target.mkdir(mode=0o700)
            for each in sorted(source.iterdir()):
                if not each.name.endswith(_BESIDE) and (each.is_dir() or each.is_file()):
                    copy(each, target / each.name)
            return
        target.touch(mode=0o600, exist_ok=False)
        with source.open("rb") as file:
            database = file.read(len(_MAGIC)) == _MAGIC
        if database:
            _copy_database(source, target)
        else:
            shutil.copyfile(source, target)
    except (OSError, sqlite3.Error) as error:
        raise SettingsError("sources", f"{source} cannot be copied: {error}") from error


def _copy_database(source: Path, target: Path) -> None:
    with (
        closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as old,
        closing(sqlite3.connect(target)) as new,
    ):
        old.backup(new)
        new.execute("PRAGMA journal_mode = DELETE").fetchall()
        (found,) = new.execute("PRAGMA integrity_check(1)").fetchone()
    if found != "ok":
        raise SettingsError("sources", f"the copy of {source} is damaged: {found}")


def _dump(url: str, target: Path) -> None:
    target.touch(mode=0o600)
    try:
        subprocess.run(  # noqa: S603 - the caller's own server
            ["pg_dump", "--format=custom", f"--file={target}", f"--dbname={url}"],  # noqa: S607
            check=True,
            capture_output=True,
            text=True,
        )
    except (OSError, subprocess.CalledProcessError) as error:
        reason = getattr(error, "stderr", None) or str(error)
        raise SettingsError("sources", f"pg_dump failed: {reason.strip()}") from error


def _name(source: str) -> str:
    """The copy's name; a URL's password is in it nowhere."""
    path = source.partition("?")[0] if source.startswith("postgresql") else source
    return Path(path.rstrip("/")).name
