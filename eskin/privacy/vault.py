"""The key store: one small file a subject, each wrapped by the master key.

Whoever writes does it by files that appear whole or not at all, so that a command, a gateway and a
second gateway may share the folder. A key is asked for with each message, and looked for on the
disk each time: what was destroyed there is used no more, from that moment.
"""

from __future__ import annotations

import json
import time
from contextlib import suppress
from threading import Lock
from typing import TYPE_CHECKING, Final

from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy.files import destroy, make_folder, read_private, write_private
from eskin.privacy.master import wrapped_key
from eskin.privacy.subject import Subject, Tombstone, is_pseudonym

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.privacy.master import Master

_SECRET: Final = "secret"  # noqa: S105 - a file's name


class Vault:
    """Keys of subjects, and what is left of those that were erased.

    Args:
        directory: Its folder; made where there is none.
        master: Wraps the keys.
        now: UTC ns.

    Raises:
        PrivacyError: The folder cannot be used.
    """

    def __init__(
        self, directory: Path, master: Master, *, now: Callable[[], int] = time.time_ns
    ) -> None:
        self.directory = directory
        self._master = master
        self._now = now
        self._keys = directory / "subjects"
        self._graves = directory / "erased"
        self._known: dict[str, Subject] = {}
        self._lock = Lock()
        for folder in (directory, self._keys, self._graves):
            make_folder(folder)
        self.finish()

    def create(self, name: str = "") -> Subject:
        """Make a subject with a fresh key; without a name it is nobody's yet.

        Raises:
            PrivacyError: It cannot be written.
        """
        made = Subject.make(name, secret=wrapped_key(self.directory / _SECRET, self._master))
        self._write(made)
        return made

    def keep(self, pseudonym: str, key: bytes) -> bool:
        """Keep a key that somebody else made; gives whether it is new.

        Raises:
            NoKeyError: The subject was erased here: what is erased never comes back.
            PrivacyError: It cannot be written.
        """
        if self.grave(pseudonym) is not None:
            raise NoKeyError(pseudonym, erased=True)
        with suppress(NoKeyError):
            self.find(pseudonym)
            return False
        self._write(Subject(pseudonym, "", b"", key))
        return True

    def find(self, pseudonym: str) -> Subject:
        """A subject with its key.

        Raises:
            NoKeyError: Its key is not here.
            PrivacyError: Its file cannot be read.
        """
        path = self._keys / pseudonym
        with self._lock:
            if not is_pseudonym(pseudonym) or not path.exists():
                self._known.pop(pseudonym, None)
                erased = is_pseudonym(pseudonym) and self.grave(pseudonym) is not None
                raise NoKeyError(pseudonym, erased=erased)
            known = self._known.get(pseudonym)
            if known is None:
                known = self._known[pseudonym] = self._read(path)
            return known

    def subjects(self) -> list[Subject]:
        """All subjects whose keys are here, by pseudonym."""
        return [self.find(name) for name in sorted(_names(self._keys))]

    def named(self, name: str) -> Subject | None:
        """The subject with a name."""
        return next((known for known in self.subjects() if known.name == name), None)

    def erase(self, pseudonym: str) -> Tombstone:
        """Destroy a subject's key and name; safe to do again, and finished after a power cut.

        Raises:
            NoKeyError: There is no such subject, and never was.
            PrivacyError: The file cannot be destroyed.
        """
        grave = self.grave(pseudonym)
        if grave is None:
            self.find(pseudonym)
            grave = Tombstone(pseudonym, self._now())
            self._bury(grave)
        with self._lock:
            self._known.pop(pseudonym, None)
            destroy(self._keys / pseudonym)
        return grave

    def bury(self, pseudonym: str) -> bool:
        """Erase a subject even where it was never known: its key, if it comes late, is not kept.

        Returns:
            Whether it is new here that it was erased.

        Raises:
            PrivacyError: It cannot be written.
        """
        if self.grave(pseudonym) is not None:
            return False
        self._bury(Tombstone(pseudonym, self._now()))
        self.erase(pseudonym)
        return True

    def confirm(self, grave: Tombstone) -> None:
        """Note that the cloud's copy is destroyed, too."""
        self._bury(Tombstone(grave.pseudonym, grave.erased, self._now()))

    def grave(self, pseudonym: str) -> Tombstone | None:
        """What is left of an erased subject.

        Raises:
            PrivacyError: It cannot be read.
        """
        path = self._graves / pseudonym
        if not path.exists():
            return None
        try:
            said = json.loads(read_private(path))
            return Tombstone(pseudonym, said["erased"], said["confirmed"])
        except (ValueError, TypeError, KeyError) as error:
            raise PrivacyError(f"{path}: is no record of an erasure") from error

    def graves(self) -> list[Tombstone]:
        """All erased subjects, by pseudonym."""
        found = [self.grave(name) for name in sorted(_names(self._graves))]
        return [grave for grave in found if grave is not None]

    def finish(self) -> None:
        """End erasures that a power cut interrupted.

        Raises:
            PrivacyError: A file cannot be destroyed.
        """
        held = _names(self._keys)
        for name in held & _names(self._graves):
            self.erase(name)
        with self._lock:
            for name in self._known.keys() - held:
                del self._known[name]

    def _bury(self, grave: Tombstone) -> None:
        said = {"erased": grave.erased, "confirmed": grave.confirmed}
        write_private(self._graves / grave.pseudonym, json.dumps(said).encode())

    def _write(self, subject: Subject) -> None:
        wrapped = self._master.wrap(subject.encode(), subject.pseudonym.encode())
        write_private(self._keys / subject.pseudonym, wrapped)

    def _read(self, path: Path) -> Subject:
        data = self._master.unwrap(read_private(path), path.name.encode())
        return Subject.decode(path.name, data)


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if is_pseudonym(path.name)}
