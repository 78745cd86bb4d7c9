"""The key store: one small file a subject, each wrapped by the master key.

A writer locks the folder and replaces files atomically, so that
a command, a gateway and a second gateway, or several clouds, may share the folder: none keeps a
key that another one erases in that instant. A key is asked for with each message, and it and its
tombstone are looked for on the disk each time: what was destroyed there is used no more, from that
instant.
"""

from __future__ import annotations

import hmac
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from eskin.errors import KeyConflictError, NoKeyError, PrivacyError
from eskin.privacy.key_erasure import KeyErasure, names_in
from eskin.privacy.master_key import wrapped_key
from eskin.privacy.subject import Subject
from eskin.runtime.files.atomic import make_folder, read_private, write_private
from eskin.runtime.files.lock import locked_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.privacy.master_key import MasterKey

_SECRET: Final = "secret"  # noqa: S105 - a file's name


class KeyStore(KeyErasure):
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
        super().__init__(directory, now)
        self._master = master
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

    def subjects(self) -> list[Subject]:
        """All subjects whose keys are here, by pseudonym."""
        found = []
        for name in sorted(names_in(self._keys)):
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

    def _write(self, subject: Subject) -> None:
        wrapped = self._master.wrap(subject.encode(), subject.pseudonym.encode())
        write_private(self._keys / subject.pseudonym, wrapped)

    def _read(self, path: Path) -> Subject:
        data = self._master.unwrap(read_private(path), path.name.encode())
        return Subject.decode(path.name, data)
