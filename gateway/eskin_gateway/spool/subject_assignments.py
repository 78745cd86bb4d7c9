"""Which subject wears a node, and since when: one small file a node, beside the keys."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Final

from eskin.errors import NoKeyError, PrivacyError
from eskin.identity import IdentityKind
from eskin.privacy import Subject
from eskin.privacy.subject import KEY_BYTES
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.atomic import make_folder, make_once, read_private, write_private
from eskin.runtime.files.lock import locked_folder
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from eskin.privacy import KeyStore
    from eskin.runtime.files.stamp import Version

ALWAYS: Final = -(2**63)


class SubjectAssignments:
    """Maps a node and a time of measurement to a subject.

    Args:
        keystore: The site's key store, in whose folder the files are.

    Raises:
        PrivacyError: The folder cannot be used.
    """

    def __init__(self, keystore: KeyStore) -> None:
        self._keystore = keystore
        self._folder = keystore.directory / "nodes"
        self._histories: dict[str, tuple[Version, list[tuple[int, str]]]] = {}
        self._erased: dict[str, Subject] = {}
        make_folder(self._folder)

    def assign(self, node: str, subject: Subject, *, since: int) -> None:
        """Assign a node to a subject.

        Args:
            node: The node.
            subject: The subject that wears it from now on.
            since: UTC ns. Earlier measurements stay with their subject.

        Raises:
            PrivacyError: The file cannot be written.
            IdentityError: The node's name is invalid.
        """
        IdentityKind.NODE.require_name(node)
        self._history(node)  # creates the file
        with locked_folder(self._folder):
            history = [entry for entry in self._history(node) if entry[0] < since]
            write_private(self._folder / node, _encode([*history, (since, subject.pseudonym)]))

    def release(self, pseudonym: str, *, since: int) -> list[str]:
        """Unassign all nodes of a subject, and return them."""
        released = [node for node, subject in self.wearers().items() if subject == pseudonym]
        for node in released:
            self.assign(node, self._keystore.create(), since=since)
        return released

    def wearers(self) -> dict[str, str]:
        """Each node's present subject, by node."""
        return {node: self._history(node)[-1][1] for node in self._nodes()}

    def all_wearers(self) -> list[tuple[str, str]]:
        """Each node with each of its subjects, in order of time."""
        ever = [(node, name) for node in self._nodes() for _, name in self._history(node)]
        return list(dict.fromkeys(ever))

    def subject(self, node: str, time: int) -> Subject:
        """Find the subject of a measurement.

        Late data of an erased subject get a random key that is not stored: they are stored once
        like all data, and can never be decrypted.

        Args:
            node: The node that measured.
            time: When it measured, UTC ns.

        Raises:
            PrivacyError: A file cannot be read or written.
        """
        history = self._history(node)
        pseudonym = next(name for since, name in reversed(history) if since <= time)
        try:
            return self._keystore.find(pseudonym)
        except NoKeyError:
            erased = Subject(pseudonym, "", b"", os.urandom(KEY_BYTES))
            return self._erased.setdefault(pseudonym, erased)

    @property
    def erased(self) -> int:
        """For how many erased subjects late data have come to this process."""
        return len(self._erased)

    def _nodes(self) -> list[str]:
        return sorted(path.name for path in self._folder.iterdir() if path.name[0] != ".")

    def _history(self, node: str) -> list[tuple[int, str]]:
        path = self._folder / node
        try:
            stamp = version(path)
        except FileNotFoundError:
            unnamed = _encode([(ALWAYS, self._keystore.create().pseudonym)])
            # Another process may have assigned the node meanwhile.
            make_once(path, lambda: unnamed)
            stamp = version(path)
        cached = self._histories.get(node)
        if cached is None or cached[0] != stamp:
            try:
                content = without_check(json.loads(read_private(path)))
                entries = [(int(since), str(name)) for since, name in content["worn"]]
            except (ValueError, TypeError, KeyError) as error:
                raise PrivacyError(
                    f"{path}: is no list of assignments: {error}; restore a copy of it, "
                    "or remove it and assign the node again (`eskin subjects assign`)"
                ) from error
            if not entries or entries[0][0] != ALWAYS:
                raise PrivacyError(f"{path}: has no assignment from the beginning")
            cached = self._histories[node] = stamp, entries
        return cached[1]


def _encode(history: list[tuple[int, str]]) -> bytes:
    return json.dumps(with_check({"worn": [list(entry) for entry in history]})).encode()
