"""A site's key store: subjects' keys, tombstones, assignments, master key."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy import FileMaster, Vault
from gateway.assignments import Assignments
from tests.bitflips.part import Part

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

log = logging.getLogger("eskin.bitflips")

_NODE: Final = "fingertip"
_MASTER: Final = "master.key"


def make(folder: Path) -> None:
    """Two subjects wear a node one after the other; a third is erased."""
    vault = Vault(folder / "keys", FileMaster(folder / _MASTER), now=lambda: 5)
    ada, bo = vault.person("Ada"), vault.person("Bo")
    assignments = Assignments(vault)
    assignments.assign(_NODE, ada, since=1000)
    assignments.assign(_NODE, bo, since=2000)
    gone = vault.person("Cy")
    vault.erase(gone.pseudonym)
    (folder / "names").write_text(f"{ada.pseudonym} {bo.pseudonym} {gone.pseudonym}")


def read(folder: Path) -> dict[str, Any]:
    """Ask for all keys, whoever wore the node, and for the erased one."""
    ada, bo, gone = (folder / "names").read_text().split()
    vault = Vault(folder / "keys", FileMaster(folder / _MASTER), now=lambda: 5)
    assignments = Assignments(vault)
    found: dict[str, Any] = {}
    asks: dict[str, Callable[[], Any]] = {
        "ada": lambda: vault.find(ada),
        "bo": lambda: vault.find(bo),
        "at 1500": lambda: assignments.subject(_NODE, 1500).pseudonym,
        "at 2500": lambda: assignments.subject(_NODE, 2500).pseudonym,
        "wearers": assignments.wearers,
        "graves": vault.graves,
        "person": lambda: vault.person("Ada").pseudonym,
        "next": lambda: len(vault.person("Di").key),
    }
    for name, ask in asks.items():
        try:
            found[name] = ask()
        except PrivacyError as error:
            log.warning("%s", error)
    try:
        vault.keep(gone, bytes(32))
        found["comes back"] = True
    except NoKeyError as error:
        found["is erased"] = error.erased
    except PrivacyError as error:
        log.warning("%s", error)
    return found


PART: Final = Part(make, read, ("keys/*", "keys/*/*", _MASTER))
