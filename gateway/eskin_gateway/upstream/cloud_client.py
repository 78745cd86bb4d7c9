"""Requests to the cloud over HTTPS, as each of the gateway's ways to it makes them."""

from __future__ import annotations

from contextlib import contextmanager
from email.utils import parsedate_to_datetime
from time import time
from typing import TYPE_CHECKING, Final

import httpx
import orjson

from eskin.errors import CloudError, IdentityError, MessageError

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Iterator

MOST_ANSWER: Final = 8_388_608
"""Bytes of an answer."""


class CloudClient:
    """Posts to resources beside the cloud's ingest; for any thread.

    Args:
        url: The cloud's ingest.
        headers: Gives those of a request.
        context: Leads to our root, and shows the gateway's certificate.
        timeout_s: Seconds to wait.
    """

    def __init__(
        self,
        url: str,
        *,
        headers: Callable[[], dict[str, str]],
        context: ssl.SSLContext,
        timeout_s: float,
    ) -> None:
        self._url = httpx.URL(url)
        self._headers = headers
        # The environment's proxies are no part of the way from a gateway to its cloud.
        self._client = httpx.Client(verify=context, timeout=timeout_s, trust_env=False)

    def close(self) -> None:
        """Close all connections."""
        self._client.close()

    def post(self, resource: str, body: bytes) -> bytes:
        """Post a body; gives the answer's.

        Args:
            resource: Its name, such as ``ingest``.
            body: CBOR.

        Raises:
            CloudError: The cloud did not answer with 200, or at too great a length.
        """
        url, found = self._url.join(resource), bytearray()
        with (
            answering(url),
            self._client.stream("POST", url, content=body, headers=self._headers()) as answer,
        ):
            require_ok(answer)
            for part in answer.iter_bytes():
                found += part
                require_short(found)
        return bytes(found)


@contextmanager
def answering(url: httpx.URL) -> Iterator[None]:
    """Raise `CloudError` where a request fails before the cloud has answered."""
    try:
        yield
    except httpx.HTTPError as error:
        raise CloudError(
            f"{url}: {type(error).__name__}: {error}",
            unanswered=isinstance(error, httpx.ReadTimeout),
        ) from error


@contextmanager
def as_agreed(body: bytes) -> Iterator[None]:
    """Raise `CloudError` where an answer cannot be read."""
    try:
        yield
    except (
        orjson.JSONDecodeError,
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
        MessageError,
        IdentityError,
    ) as error:
        said = body[:100]
        raise CloudError(f"the cloud's answer is not as agreed: {said!r}: {error}") from error


def require_short(body: bytes | bytearray) -> None:
    """Require that an answer is not too long.

    Raises:
        CloudError: It is longer than `MOST_ANSWER`.
    """
    if len(body) > MOST_ANSWER:
        raise CloudError(f"the cloud's answer is longer than {MOST_ANSWER} bytes")


def require_ok(answer: httpx.Response) -> None:
    """Require status 200; the body need not have been read.

    Raises:
        CloudError: It has another status.
    """
    if answer.status_code == httpx.codes.OK:
        return
    raise CloudError(
        f"{answer.url} answered {answer.status_code} {answer.reason_phrase}",
        status=answer.status_code,
        retry_after=_patience(answer.headers.get("Retry-After")),
    )


def _patience(value: str | None) -> float | None:
    """Seconds of a Retry-After: a number, or a date (RFC 9110, section 10.2.3)."""
    if value is None:
        return None
    if value.isascii() and value.isdigit():
        return float(value[:9])
    try:
        return max(0.0, parsedate_to_datetime(value).timestamp() - time())
    except (ValueError, OverflowError):
        return None
