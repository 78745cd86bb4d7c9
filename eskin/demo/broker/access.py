"""Who may publish and read what: the same rules as in ``eskin/mosquitto/acl``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from cryptography import x509

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind, common_name, issuer_kind
from eskin.wire.topics import FROM_NODE, NODES, PUBLIC, Stream, parse_node_topic

_OPEN: Final = tuple(f"{root}/" for root in PUBLIC)
_TO_NODE: Final = (Stream.ACKS, Stream.COMMANDS)


@dataclass(frozen=True, slots=True)
class Party:
    """A connected client, as its verified certificate names it.

    Attributes:
        kind: Kind of identity, from the issuing CA.
        name: Common name.
    """

    kind: IdentityKind
    name: str

    @classmethod
    def of(cls, certificate: bytes | None) -> Party:
        """Read the certificate (DER) that TLS has verified up to the root.

        Raises:
            IdentityError: There is none, or it is not one of eskin.
        """
        if not certificate:
            raise IdentityError("no client certificate was shown")
        try:
            leaf = x509.load_der_x509_certificate(certificate)
        except ValueError as error:
            raise IdentityError(f"client certificate cannot be read: {error}") from error
        kind, name = issuer_kind(leaf), common_name(leaf)
        kind.require_name(name)
        return cls(kind, name)


def may_publish(party: Party, topic: str) -> bool:
    """Whether the party may write to a topic."""
    if party.kind is IdentityKind.GATEWAY and topic.startswith(_OPEN):
        return True
    node, stream = _split(topic)
    if party.kind is IdentityKind.NODE:
        return node == party.name and stream in FROM_NODE
    return party.kind is IdentityKind.GATEWAY and stream in _TO_NODE


def may_subscribe(party: Party, pattern: str) -> bool:
    """Whether the party may read all that a topic, or a filter, can match."""
    if pattern.startswith(_OPEN):
        return party.kind in {IdentityKind.CLIENT, IdentityKind.GATEWAY}
    if party.kind is IdentityKind.GATEWAY:
        # A filter's wildcard stands for any one node.
        _, stream = _split(pattern.replace(f"{NODES}/+/", f"{NODES}/any/", 1))
        return stream in FROM_NODE
    node, stream = _split(pattern)
    return party.kind is IdentityKind.NODE and node == party.name and stream in _TO_NODE


def _split(topic: str) -> tuple[str, Stream | None]:
    try:
        return parse_node_topic(topic)
    except MessageError:
        return "", None
