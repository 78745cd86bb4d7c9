"""Receiving what a gateway posts: who it is comes first, then a body of bounded size."""

from __future__ import annotations

import asyncio
import ssl
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, TypeVar

from eskin.errors import UntrustedCertificateError
from eskin.identity import common_name, site_of
from eskin_cloud.api.middleware.answer import recheck
from eskin_cloud.ingest.errors import BatchTooLargeError, BatchTypeError, UntrustedGatewayError
from eskin_cloud.ingest.gateway_status import HEADER, read_status

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from cryptography import x509
    from fastapi import Request

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.write.gateways import GatewayStatus

MEDIA_TYPE: Final = "application/cbor"
T = TypeVar("T")
_SMALL: Final = 65_536
"""Bytes that are read in half a millisecond."""
_LINKS: Final = 2
"""Of a chain: the gateway's certificate and its issuing CA's. The root is ours."""


@dataclass(frozen=True, slots=True)
class GatewayIdentity:
    """A gateway that proved who it is, in its connection's TLS handshake.

    Attributes:
        name: Common name.
        site: The site that its certificate names.
        certificate: Verified.
    """

    name: str
    site: str
    certificate: x509.Certificate


@dataclass(frozen=True, slots=True)
class Received:
    """What a gateway posted.

    Attributes:
        gateway: Which one.
        condition: The status that it reported, if any.
        body: All of it.
    """

    gateway: GatewayIdentity
    condition: GatewayStatus | None
    body: bytes


@asynccontextmanager
async def received(cloud: AppState, request: Request) -> AsyncIterator[Received]:
    """What a gateway posts; its body has room while this runs.

    Args:
        cloud: The cloud.
        request: Its request.

    Raises:
        IngestError: It is not CBOR, from no gateway of ours, or too long.
        StoreError: Too many bytes wait to be stored.
    """
    kind = request.headers.get("content-type")
    if (kind or "").partition(";")[0].strip().lower() != MEDIA_TYPE:
        raise BatchTypeError(f"Content-Type is {kind!r}; send {MEDIA_TYPE}")
    identify(cloud, request)  # before its body takes memory
    recheck(request, lambda: identify(cloud, request))
    condition = read_status(request.headers.get(HEADER))
    most = cloud.settings.gateways.body_bytes
    announced = request.headers.get("content-length", "")
    size = int(announced) if announced.isdecimal() else most
    if size > most:
        raise _too_large(most)
    with cloud.uploads.hold(size):
        body = await _read(request, most)
        # It may have been revoked while its body came.
        yield Received(identify(cloud, request), condition, body)


def identify(cloud: AppState, request: Request) -> GatewayIdentity:
    """Which gateway asks; judged by the certificates and lists of now.

    Raises:
        UntrustedGatewayError: None of ours, or no more.
    """
    tls = request.scope.get("extensions", {}).get("tls", {})
    try:
        certificate = cloud.gateway_trust.verify(_der(tls.get("client_cert_chain", ())))
    except UntrustedCertificateError as error:
        raise UntrustedGatewayError(f"the gateway's certificate is refused: {error}") from error
    return GatewayIdentity(common_name(certificate), site_of(certificate), certificate)


@lru_cache(64)
def _der(chain: tuple[str, ...]) -> tuple[bytes, ...]:
    return tuple(ssl.PEM_cert_to_DER_cert(part) for part in chain[:_LINKS])


async def apart(size: int, work: Callable[[], T]) -> T:
    """Do work in a thread of its own, unless it is so small that the way there takes longer.

    Args:
        size: Bytes that it looks at.
        work: What is done.
    """
    return work() if size <= _SMALL else await asyncio.to_thread(work)


async def _read(request: Request, most: int) -> bytes:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > most:
            raise _too_large(most)
    return bytes(body)


def _too_large(most: int) -> BatchTooLargeError:
    return BatchTooLargeError(f"the body is longer than {most} bytes; send smaller batches")
