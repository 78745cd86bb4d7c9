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
from eskin.runtime.files.stamp import version
from eskin.runtime.files.turn import turn

if TYPE_CHECKING:
    from eskin.privacy import KeyStore
    from eskin.runtime.files.stamp import Version

ALWAYS: Final = -(2**63)


class SubjectAssignments:
    """Says whose data a node's message is: of whoever wore the node when it was measured.

    Args:
        keystore: The site's key store, in whose folder they lie.

    Raises:
        PrivacyError: The folder cannot be used.
    """

    def __init__(self, keystore: KeyStore) -> None:
        self._keystore = keystore
        self._folder = keystore.directory / "nodes"
        self._read: dict[str, tuple[Version, list[tuple[int, str]]]] = {}
        self._lost: dict[str, Subject] = {}
        make_folder(self._folder)

    def assign(self, node: str, subject: Subject, *, since: int) -> None:
        """Have a subject wear a node.

        Args:
            node: The node.
            subject: Who wears it, or nobody.
            since: UTC ns; what was measured before stays whose it is.

        Raises:
            PrivacyError: It cannot be written.
            IdentityError: The node's name is none.
        """
        IdentityKind.NODE.require_name(node)
        self._history(node)  # there is one from here on
        with turn(self._folder):
            history = [entry for entry in self._history(node) if entry[0] < since]
            self._write(node, [*history, (since, subject.pseudonym)])

    def release(self, pseudonym: str, *, since: int) -> list[str]:
        """Have nobody wear the nodes that a subject wears; gives which they were."""
        worn = [node for node, wearer in self.wearers().items() if wearer == pseudonym]
        for node in worn:
            self.assign(node, self._keystore.create(), since=since)
        return worn

    def wearers(self) -> dict[str, str]:
        """Each node's present subject, by node."""
        return {node: self._history(node)[-1][1] for node in self._nodes()}

    def worn(self) -> list[tuple[str, str]]:
        """Each node with each subject that ever wore it, by node, the first wearer first."""
        ever = [(node, name) for node in self._nodes() for _, name in self._history(node)]
        return list(dict.fromkeys(ever))

    def subject(self, node: str, moment: int) -> Subject:
        """Whose data it is.

        Data of an erased subject that come late are given a key that nobody keeps: they are stored
        once like all else, and can never be read.

        Args:
            node: Who said it.
            moment: When it was measured, UTC ns.

        Raises:
            PrivacyError: A file cannot be read or written.
        """
        history = self._history(node)
        pseudonym = next(name for since, name in reversed(history) if since <= moment)
        try:
            return self._keystore.find(pseudonym)
        except NoKeyError:
            lost = Subject(pseudonym, "", b"", os.urandom(KEY_BYTES))
            return self._lost.setdefault(pseudonym, lost)

    def _nodes(self) -> list[str]:
        return sorted(path.name for path in self._folder.iterdir() if path.name[0] != ".")

    def _history(self, node: str) -> list[tuple[int, str]]:
        path = self._folder / node
        try:
            seen = version(path)
        except FileNotFoundError:
            nobody = _encoded([(ALWAYS, self._keystore.create().pseudonym)])
            # Somebody may have said meanwhile who wears it.
            make_once(path, lambda: nobody)
            seen = version(path)
        known = self._read.get(node)
        if known is None or known[0] != seen:
            try:
                said = without_check(json.loads(read_private(path)))
                entries = [(int(since), str(name)) for since, name in said["worn"]]
            except (ValueError, TypeError, KeyError) as error:
                raise PrivacyError(
                    f"{path}: is no list of who wore the node: {error}; bring back a copy of it, "
                    "or remove it and say who wears the node (`eskin subjects assign`)"
                ) from error
            if not entries or entries[0][0] != ALWAYS:
                raise PrivacyError(f"{path}: does not say who wore the node from the beginning")
            known = self._read[node] = seen, entries
        return known[1]

    def _write(self, node: str, history: list[tuple[int, str]]) -> None:
        write_private(self._folder / node, _encoded(history))


def _encoded(history: list[tuple[int, str]]) -> bytes:
    return json.dumps(with_check({"worn": [list(entry) for entry in history]})).encode()
