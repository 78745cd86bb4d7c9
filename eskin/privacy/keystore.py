"""The key store: one small file a subject, each wrapped by the master key.

A writer locks the folder and replaces files atomically, so that
a command, a gateway and a second gateway, or several clouds, may share the folder: none keeps a
key that another one erases in that moment. A key is asked for with each message, and it and its
tombstone are looked for on the disk each time: what was destroyed there is used no more, from that
moment.
"""

from __future__ import annotations

import hmac
import json
import time
from contextlib import suppress
from threading import Lock
from typing import TYPE_CHECKING, Final

from eskin.errors import KeyConflictError, NoKeyError, PrivacyError
from eskin.privacy.master_key import wrapped_key
from eskin.privacy.subject import Subject, Tombstone, is_pseudonym
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.atomic import destroy, make_folder, partials, read_private, write_private
from eskin.runtime.files.lock import locked_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.privacy.master_key import MasterKey

_SECRET: Final = "secret"  # noqa: S105 - a file's name


class KeyStore:
    """Keys of subjects, and what is left of those that were erased.

    Args:
        directory: Its folder; made where there is none.
        master: Wraps the keys.
        now: UTC ns.

    Raises:
        PrivacyError: The folder cannot be used.
    """

    def __init__(
        self, directory: Path, master: MasterKey, *, now: Callable[[], int] = time.time_ns
    ) -> None:
        self.directory = directory
        self._master = master
        self._now = now
        self._keys = directory / "subjects"
        self._tombstones = directory / "erased"
        self._known: dict[str, Subject] = {}
        self._lock = Lock()
        self._folders = directory, self._keys, self._tombstones
        for folder in self._folders:
            make_folder(folder)
        self.finish()

    def below(self, name: str) -> KeyStore:
        """A key store of its own in a folder of this one, under the same master key.

        Args:
            name: Of the folder.

        Raises:
            PrivacyError: The folder cannot be used.
        """
        return KeyStore(self.directory / name, self._master, now=self._now)

    def create(self, name: str = "") -> Subject:
        """Make a subject with a fresh key; without a name it is unassigned.

        Raises:
            PrivacyError: It cannot be written.
        """
        made = Subject.make(name, secret=wrapped_key(self.directory / _SECRET, self._master))
        with locked_folder(self.directory):
            self._write(made)
        return made

    def keep(self, pseudonym: str, key: bytes) -> bool:
        """Store a key that another site made; gives whether it is new.

        Raises:
            NoKeyError: The subject was erased here: what is erased never comes back.
            KeyConflictError: Another key is kept for that subject, which stays.
            PrivacyError: It cannot be written.
        """
        with locked_folder(self.directory):
            try:
                kept = self.find(pseudonym).key
            except NoKeyError as error:
                if error.erased:
                    raise
                self._write(Subject(pseudonym, "", b"", key))
                return True
            if not hmac.compare_digest(kept, key):
                raise KeyConflictError(f"subject {pseudonym} has another key here, which stays")
            return False

    def find(self, pseudonym: str) -> Subject:
        """A subject with its key.

        Raises:
            NoKeyError: Its key is not here.
            PrivacyError: Its file cannot be read.
        """
        with self._lock:
            try:
                self.require(pseudonym)
                known = self._known.get(pseudonym)
                if known is None:
                    known = self._known[pseudonym] = self._read(self._keys / pseudonym)
            except PrivacyError:
                self._known.pop(pseudonym, None)
                self.require(pseudonym)  # it may have been erased while it was read
                raise
            return known

    def require(self, pseudonym: str) -> None:
        """Refuse what has no key here, without reading it; a tombstone counts before a key.

        Raises:
            NoKeyError: Its key is not here.
            PrivacyError: Its tombstone cannot be read.
        """
        erased = is_pseudonym(pseudonym) and self.tombstone(pseudonym) is not None
        if erased or not is_pseudonym(pseudonym) or not (self._keys / pseudonym).exists():
            raise NoKeyError(pseudonym, erased=erased)

    def subjects(self) -> list[Subject]:
        """All subjects whose keys are here, by pseudonym."""
        found = []
        for name in sorted(_names(self._keys)):
            with suppress(NoKeyError):
                found.append(self.find(name))
        return found

    def named(self, name: str) -> list[Subject]:
        """The subjects with a name: one, or several that were made at once before `person` was."""
        return [known for known in self.subjects() if known.name == name]

    def person(self, name: str) -> Subject:
        """The subject with a name; made where there is none, by one alone of those who ask for it.

        Raises:
            PrivacyError: It cannot be read or written.
        """
        known = self.named(name)  # reads all keys, which takes long in hardware, for what follows
        secret = wrapped_key(self.directory / _SECRET, self._master)
        with locked_folder(self.directory):
            known = known or self.named(name)
            if known:
                return known[0]
            made = Subject.make(name, secret=secret)
            self._write(made)
            return made

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
            said = without_check(json.loads(read_private(path)))
            return Tombstone(pseudonym, said["erased"], said["confirmed"])
        except (ValueError, TypeError, KeyError) as error:
            raise PrivacyError(f"{path}: is no record of an erasure") from error

    def tombstones(self) -> list[Tombstone]:
        """All erased subjects, by pseudonym."""
        found = [self.tombstone(name) for name in sorted(_names(self._tombstones))]
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
        held = _names(self._keys)
        with self._lock:
            for name in self._known.keys() - held:
                del self._known[name]

    def _unfinished(self) -> bool:
        return bool(self._half_erased()) or any(map(partials, self._folders))

    def _half_erased(self) -> set[str]:
        return _names(self._keys) & _names(self._tombstones)

    def _sweep(self) -> None:
        for folder in self._folders:
            for path in partials(folder):
                destroy(path)

    def _erase(self, pseudonym: str, tombstone: Tombstone | None) -> Tombstone:
        """Erase within a turn: the tombstone first, so that a power cut undoes nothing."""
        if tombstone is None:
            tombstone = Tombstone(pseudonym, self._now())
            self._write_tombstone(tombstone)
        with self._lock:
            self._known.pop(pseudonym, None)
            destroy(self._keys / pseudonym)
        self._sweep()  # among them may be a copy of the key
        return tombstone

    def _write_tombstone(self, tombstone: Tombstone) -> None:
        said = with_check({"erased": tombstone.erased, "confirmed": tombstone.confirmed})
        write_private(self._tombstones / tombstone.pseudonym, json.dumps(said).encode())

    def _write(self, subject: Subject) -> None:
        wrapped = self._master.wrap(subject.encode(), subject.pseudonym.encode())
        write_private(self._keys / subject.pseudonym, wrapped)

    def _read(self, path: Path) -> Subject:
        data = self._master.unwrap(read_private(path), path.name.encode())
        return Subject.decode(path.name, data)


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if is_pseudonym(path.name)}
