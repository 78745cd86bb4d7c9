"""Nodes' certificates, which a gateway presents: to which site each node belongs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import IdentityError, MessageError
from eskin.identity import common_name, der, site_of
from eskin.wire.messages.cbor_map import items, load_any
from eskin_cloud.ingest.errors import MalformedBatchError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.ingest.gateway_trust import GatewayTrust

MOST: Final = 500
_MOST_BYTES: Final = 4096


class Presented(NamedTuple):
    """One chain that was presented.

    Attributes:
        node: Whose it is; empty where that cannot be read.
        certificate: The node's own (DER).
        reason: Why it is refused; ``None`` where it is good.
    """

    node: str
    certificate: bytes
    reason: str | None = None


def read_chains(body: bytes) -> list[list[bytes]]:
    """Read what a gateway presents: CBOR array of chains, each the node's and its issuing CA's.

    Raises:
        MalformedBatchError: It is none.
    """
    try:
        listed = [items(chain, "chain", 2) for chain in items(load_any(body, "body"), "body", MOST)]
    except MessageError as error:
        raise MalformedBatchError(f"{error}; send a CBOR array of [leaf, issuer]") from error
    for chain in listed:
        for part in chain:
            if not isinstance(part, bytes) or len(part) > _MOST_BYTES:
                raise MalformedBatchError(f"a certificate is no byte string up to {_MOST_BYTES}")
    return [[bytes(part) for part in chain if isinstance(part, bytes)] for chain in listed]


def judge_chains(
    gateway_trust: GatewayTrust, chains: Sequence[Sequence[bytes]], site: str
) -> list[Presented]:
    """Verify chains, and that each names the gateway's own site.

    Args:
        gateway_trust: Verifies them.
        chains: As `read_chains` gives them.
        site: The site that the gateway's certificate names.
    """
    return [_judge(gateway_trust, chain, site) for chain in chains]


def _judge(gateway_trust: GatewayTrust, chain: Sequence[bytes], site: str) -> Presented:
    try:
        leaf = gateway_trust.verify_node(chain)
        name, own = common_name(leaf), site_of(leaf)
    except IdentityError as error:
        return Presented("", b"", str(error))
    if own != site:
        return Presented(name, b"", f"{name} is a node of {own}, and the gateway is one of {site}")
    return Presented(name, der(leaf))
