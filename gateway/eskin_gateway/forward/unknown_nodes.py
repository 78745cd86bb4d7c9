"""Nodes that the cloud does not know: their certificates are presented, their messages wait."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from eskin_gateway.upstream.certificates_client import Certificates

log = logging.getLogger(__name__)

_PAUSE_S: Final = 60.0


class UnknownNodes:
    """Presents certificates, and keeps aside the nodes whose certificate the cloud refuses.

    Their messages stay in the spool and are tried again each minute; others go on.

    Args:
        certificates: The way to the cloud.
        clock: Seconds that never go back.
    """

    def __init__(
        self, certificates: Certificates, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._certificates = certificates
        self._clock = clock
        self._presented: set[str] = set()
        self._refused: dict[str, tuple[float, str]] = {}

    def waiting(self) -> list[str]:
        """Nodes whose messages are left out now."""
        now = self._clock()
        for node in [node for node, (due, _) in self._refused.items() if due <= now]:
            del self._refused[node]
        return list(self._refused)

    def present(self, nodes: Collection[str]) -> None:
        """Present the certificates of nodes that the cloud does not know.

        Raises:
            CloudError: The cloud did not answer as agreed.
            SpoolError: The spool cannot be read.
        """
        again = dict.fromkeys(self._presented.intersection(nodes), "it is unknown still")
        refused = again | self._certificates.present(set(nodes) - self._presented)
        due = self._clock() + _PAUSE_S
        for node, reason in refused.items():
            self._refused[node] = due, reason
            log.warning("cloud refuses a node's certificate: node=%s reason=%s", node, reason)
        self._presented -= refused.keys()
        self._presented |= set(nodes) - refused.keys()

    def known(self, nodes: Collection[str]) -> None:
        """The cloud took messages of these nodes."""
        self._presented -= set(nodes)

    @property
    def fault(self) -> str | None:
        """What is to be told of it; ``None`` where none is refused."""
        if not self._refused:
            return None
        node, (_, reason) = next(iter(self._refused.items()))
        return (
            f"the cloud refuses {len(self._refused)} node(s), one of them {node}: {reason}; their "
            "messages stay in the spool"
        )
