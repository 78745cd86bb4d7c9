"""Erase subjects from a key store: destroy the key, and keep a tombstone.

The tombstone is written first, so that a power cut undoes nothing: `KeyStore.finish` goes on.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy.subject import is_pseudonym
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.atomic import destroy, partials, read_private, write_private
from eskin.runtime.files.lock import locked_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.privacy.subject import Subject


@dataclass(frozen=True, slots=True)
class Tombstone:
    """What is left of a subject whose key is destroyed.

    Attributes:
        pseudonym: The subject's.
        erased: When its key was destroyed here, UTC ns.
        confirmed: When the cloud confirmed that its copy is destroyed; ``None`` while it has not.
    """

    pseudonym: str
    erased: int
    confirmed: int | None = None


class KeyErasure:
    """The part of a key store that destroys keys, on disk and in memory, and keeps tombstones.

    Args:
        directory: The key store's folder.
        now: UTC ns.
    """

    def __init__(self, directory: Path, now: Callable[[], int]) -> None:
        self.directory = directory
        self._now = now
        self._keys = directory / "subjects"
        self._tombstones = directory / "erased"
        self._folders = directory, self._keys, self._tombstones
        self._known: dict[str, Subject] = {}
        self._lock = Lock()

    def require(self, pseudonym: str) -> None:
        """Refuse what has no key here, without reading it; a tombstone counts before a key.

        Raises:
            NoKeyError: Its key is not here.
            PrivacyError: Its tombstone cannot be read.
        """
        erased = is_pseudonym(pseudonym) and self.tombstone(pseudonym) is not None
        if erased or not is_pseudonym(pseudonym) or not (self._keys / pseudonym).exists():
            raise NoKeyError(pseudonym, erased=erased)

    def erase(self, pseudonym: str) -> Tombstone:
        """Destroy a subject's key and name; safe to do again, and finished after a power cut.

        Raises:
            NoKeyError: There is no such subject, and never was.
            PrivacyError: The file cannot be destroyed.
        """
        with locked_folder(self.directory):
            tombstone = self.tombstone(pseudonym)
            if tombstone is None:
                self.require(pseudonym)
            return self._erase(pseudonym, tombstone)

    def shred(self, pseudonym: str) -> bool:
        """Erase a subject even where it was never known: its key, if it comes late, is not kept.

        Returns:
            Whether it is new here that it was erased.

        Raises:
            PrivacyError: It cannot be written.
        """
        with locked_folder(self.directory):
            tombstone = self.tombstone(pseudonym)
            self._erase(pseudonym, tombstone)
        return tombstone is None

    def confirm(self, tombstone: Tombstone) -> None:
        """Note that the cloud's copy is destroyed, too."""
        with locked_folder(self.directory):
            self._write_tombstone(Tombstone(tombstone.pseudonym, tombstone.erased, self._now()))

    def tombstone(self, pseudonym: str) -> Tombstone | None:
        """What is left of an erased subject.

        Raises:
            PrivacyError: It cannot be read.
        """
        path = self._tombstones / pseudonym
        if not path.exists():
            return None
        try:
            fields = without_check(json.loads(read_private(path)))
            return Tombstone(pseudonym, fields["erased"], fields["confirmed"])
        except (ValueError, TypeError, KeyError) as error:
            raise PrivacyError(f"{path}: is no record of an erasure") from error

    def tombstones(self) -> list[Tombstone]:
        """All erased subjects, by pseudonym."""
        found = [self.tombstone(name) for name in sorted(names_in(self._tombstones))]
        return [tombstone for tombstone in found if tombstone is not None]

    def finish(self) -> None:
        """End erasures that a power cut interrupted, and destroy what it left of unfinished files.

        Raises:
            PrivacyError: A file cannot be destroyed.
        """
        if self._unfinished():
            with locked_folder(self.directory):  # no writer is left
                for name in self._half_erased():
                    self._erase(name, self.tombstone(name))
                self._sweep()
        held = names_in(self._keys)
        with self._lock:
            for name in self._known.keys() - held:
                del self._known[name]

    def _unfinished(self) -> bool:
        return bool(self._half_erased()) or any(map(partials, self._folders))

    def _half_erased(self) -> set[str]:
        return names_in(self._keys) & names_in(self._tombstones)

    def _sweep(self) -> None:
        for folder in self._folders:
            for path in partials(folder):
                destroy(path)

    def _erase(self, pseudonym: str, tombstone: Tombstone | None) -> Tombstone:
        """Erase while the folder is locked."""
        if tombstone is None:
            tombstone = Tombstone(pseudonym, self._now())
            self._write_tombstone(tombstone)
        with self._lock:
            self._known.pop(pseudonym, None)
            destroy(self._keys / pseudonym)
        self._sweep()  # among them may be a copy of the key
        return tombstone

    def _write_tombstone(self, tombstone: Tombstone) -> None:
        fields = with_check({"erased": tombstone.erased, "confirmed": tombstone.confirmed})
        write_private(self._tombstones / tombstone.pseudonym, json.dumps(fields).encode())


def names_in(folder: Path) -> set[str]:
    """The pseudonyms that a folder has files of."""
    return {path.name for path in folder.iterdir() if is_pseudonym(path.name)}
