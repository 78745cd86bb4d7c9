"""Receiving what a gateway posts: who it is comes first, then a body of bounded size."""

from __future__ import annotations

import asyncio
import hashlib
from typing import TYPE_CHECKING, Final

from cloud.ingest.errors import BatchTooLargeError, BatchTypeError

if TYPE_CHECKING:
    from fastapi import Request

    from cloud.ingest.warrant import Warrant
    from cloud.state import Cloud

MEDIA_TYPE: Final = "application/cbor"


async def receive(cloud: Cloud, request: Request) -> tuple[Warrant, bytes]:
    """The gateway's warrant, and the body that it was made for.

    Raises:
        IngestError: It is not CBOR, from no gateway of ours, too long, or of another hash.
    """
    kind = request.headers.get("content-type")
    if (kind or "").partition(";")[0].strip().lower() != MEDIA_TYPE:
        raise BatchTypeError(f"Content-Type is {kind!r}; send {MEDIA_TYPE}")
    # A stranger shall not fill our memory.
    authorization = request.headers.get("authorization")
    warrant = await asyncio.to_thread(cloud.verifier.verify, authorization)
    body = await _read(request, cloud.settings.gateways.body_bytes)
    digest = await asyncio.to_thread(lambda: hashlib.sha256(body).hexdigest())
    warrant.require_body(digest)
    return warrant, body


async def _read(request: Request, most: int) -> bytes:
    announced = request.headers.get("content-length", "")
    body = bytearray()
    if not announced.isdecimal() or int(announced) <= most:
        async for part in request.stream():
            body += part
            if len(body) > most:
                break
        else:
            return bytes(body)
    raise BatchTooLargeError(f"the body is longer than {most} bytes; send smaller batches")
