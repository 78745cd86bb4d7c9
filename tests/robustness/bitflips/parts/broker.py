"""A broker's trust in nodes, as OpenSSL reads it for Mosquitto: anchors and revocation lists."""

from __future__ import annotations

import logging
import ssl
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final

from eskin.identity import Identity, IdentityKind
from tests.robustness.bitflips.part import Part
from tests.support.identities import Identities

log = logging.getLogger("eskin.bitflips")

_ANCHORS: Final = "node.anchor.pem"
_LIST: Final = "node.crl.pem"
_ROUNDS: Final = 8


@cache
def _parties() -> tuple[Identities, Identities]:
    """Of this CA, with a revoked node, and of another CA."""
    own = Identities(Path(mkdtemp(prefix="eskin-bitflips-")))
    own.make(IdentityKind.NODE, "revoked")
    own.make(IdentityKind.SERVER, "server.broker")
    own.authority.revoke("revoked")
    return own, Identities(Path(mkdtemp(prefix="eskin-bitflips-")))


def make(folder: Path) -> None:
    """Copy what the CA publishes for brokers."""
    own, _ = _parties()
    for name in (_ANCHORS, _LIST):
        (folder / name).write_bytes((own.ca / name).read_bytes())


def read(folder: Path) -> dict[str, Any]:
    """Let a good node, a revoked one, one of another CA and a gateway connect."""
    own, other = _parties()
    clients = {
        "good": own.ca.parent / "fingertip",
        "revoked": own.ca.parent / "revoked",
        "foreign": other.ca.parent / "fingertip",
        "gateway": own.ca.parent / "gateway.g1",
    }
    return {
        f"{name} may": True for name, path in clients.items() if _is_admitted(folder, name, path)
    }


def _is_admitted(folder: Path, name: str, client: Path) -> bool:
    own, _ = _parties()
    try:
        server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        server.load_cert_chain(*_files(own.ca.parent / "server.broker"))
        server.verify_mode = ssl.CERT_REQUIRED
        server.verify_flags |= ssl.VERIFY_CRL_CHECK_LEAF | ssl.VERIFY_X509_PARTIAL_CHAIN
        for file in (_ANCHORS, _LIST):
            server.load_verify_locations(folder / file)
        near = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        near.check_hostname, near.verify_mode = False, ssl.CERT_NONE
        near.load_cert_chain(*_files(client))
        _shake_hands(server, near)
    except ssl.SSLError as error:  # as Mosquitto logs it
        log.warning("connection refused: client=%s reason=%s", name, error.reason)
        return False
    return True


def _files(folder: Path) -> tuple[Path, Path]:
    loaded = Identity.load(folder)
    assert loaded.name
    return folder / "chain.pem", folder / "key.pem"


def _shake_hands(server: ssl.SSLContext, client: ssl.SSLContext) -> None:
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    sides = [
        server.wrap_bio(up, down, server_side=True),
        client.wrap_bio(down, up, server_side=False),
    ]
    for _ in range(_ROUNDS):
        for side in list(sides):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
            sides.remove(side)
    assert not sides, "the handshake does not end"


PART: Final = Part(make, read, (_ANCHORS, _LIST))
