"""Receiving what a gateway posts: who it is comes first, then a body of bounded size."""

from __future__ import annotations

import asyncio
import hashlib
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Final, TypeVar

from cloud.ingest.errors import BatchTooLargeError, BatchTypeError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from fastapi import Request

    from cloud.ingest.warrant import Warrant
    from cloud.state import Cloud

MEDIA_TYPE: Final = "application/cbor"
T = TypeVar("T")
_SMALL: Final = 65_536
"""Bytes that are read and hashed in half a millisecond."""


@asynccontextmanager
async def received(
    cloud: Cloud, request: Request, *, within: bool = False
) -> AsyncIterator[tuple[Warrant, bytes]]:
    """The gateway's warrant, and the body that it was made for, which has room while this runs.

    Args:
        cloud: The cloud.
        request: What a gateway posts.
        within: The caller asks `Warrant.is_first` in its own transaction.

    Raises:
        IngestError: It is not CBOR, from no gateway of ours, too long, or of another hash.
        StoreError: Too many bytes wait to be stored.
    """
    kind = request.headers.get("content-type")
    if (kind or "").partition(";")[0].strip().lower() != MEDIA_TYPE:
        raise BatchTypeError(f"Content-Type is {kind!r}; send {MEDIA_TYPE}")
    # A stranger shall not fill our memory.
    authorization = request.headers.get("authorization")
    warrant = await asyncio.to_thread(cloud.verifier.verify, authorization, within=within)
    most = cloud.settings.gateways.body_bytes
    announced = request.headers.get("content-length", "")
    size = int(announced) if announced.isdecimal() else most
    if size > most:
        raise _too_large(most)
    with cloud.uploads.hold(size):
        body = await _read(request, most)
        digest = await apart(len(body), lambda: hashlib.sha256(body).hexdigest())
        warrant.require_body(digest)
        yield warrant, body


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
