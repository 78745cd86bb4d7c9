"""A site's key store: subjects' keys, tombstones, assignments, master key."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final

from eskin_gateway.spool.subject_assignments import SubjectAssignments

from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy import FileMasterKey, KeyStore
from tests.robustness.bitflips.part import Part

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

log = logging.getLogger("eskin.bitflips")

_NODE: Final = "fingertip"
_MASTER: Final = "master.key"


def make(folder: Path) -> None:
    """Two subjects wear a node one after the other; a third is erased."""
    keystore = KeyStore(folder / "keys", FileMasterKey(folder / _MASTER), now=lambda: 5)
    ada, bo = keystore.person("Ada"), keystore.person("Bo")
    assignments = SubjectAssignments(keystore)
    assignments.assign(_NODE, ada, since=1000)
    assignments.assign(_NODE, bo, since=2000)
    gone = keystore.person("Cy")
    keystore.erase(gone.pseudonym)
    (folder / "names").write_text(f"{ada.pseudonym} {bo.pseudonym} {gone.pseudonym}")


def read(folder: Path) -> dict[str, Any]:
    """Ask for the keys of all wearers of the node, and for the erased one."""
    ada, bo, gone = (folder / "names").read_text().split()
    keystore = KeyStore(folder / "keys", FileMasterKey(folder / _MASTER), now=lambda: 5)
    assignments = SubjectAssignments(keystore)
    found: dict[str, Any] = {}
    asks: dict[str, Callable[[], Any]] = {
        "ada": lambda: keystore.find(ada),
        "bo": lambda: keystore.find(bo),
        "at 1500": lambda: assignments.subject(_NODE, 1500).pseudonym,
        "at 2500": lambda: assignments.subject(_NODE, 2500).pseudonym,
        "wearers": assignments.wearers,
        "tombstones": keystore.tombstones,
        "person": lambda: keystore.person("Ada").pseudonym,
        "next": lambda: len(keystore.person("Di").key),
    }
    for name, ask in asks.items():
        try:
            found[name] = ask()
        except PrivacyError as error:
            log.warning("%s", error)
    try:
        keystore.keep(gone, bytes(32))
        found["comes back"] = True
    except NoKeyError as error:
        found["is erased"] = error.erased
    except PrivacyError as error:
        log.warning("%s", error)
    return found


PART: Final = Part(make, read, ("keys/*", "keys/*/*", _MASTER))
