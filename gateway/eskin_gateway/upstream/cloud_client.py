"""HTTPS requests to the cloud's resources for gateways, and to another cloud when one fails."""

from __future__ import annotations

import logging
import socket
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any, Final

import httpx
import orjson

from eskin.errors import CloudError, IdentityError, MessageError
from eskin.wire.slot import even_groups

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Iterator, Mapping, Sequence

log = logging.getLogger(__name__)

_FAILS: Final = {
    httpx.codes.BAD_GATEWAY,
    httpx.codes.SERVICE_UNAVAILABLE,
    httpx.codes.GATEWAY_TIMEOUT,
}
MAX_RESPONSE: Final = 8_388_608
"""Bytes of a response."""
_CONNECT_S: Final = 5.0
"""Most seconds to connect to one of several clouds."""
_CONNECT_AGAIN_S: Final = 1.0
"""Most seconds to connect to one that failed before: what is for others waits meanwhile."""
_LEFT_OUT_S: Final = (5.0, 300.0)
"""Seconds for which a cloud that failed is left out: at first, and at most."""


@dataclass(frozen=True, slots=True)
class _Outage:
    """Until when a cloud is left out, in the clock's seconds, and for how long in all."""

    until: float
    seconds: float


class CloudClient:
    """Posts to resources beside the cloud's ingest. Thread-safe.

    Several clouds may share a store. Each has a range of slots, the same one for all gateways: what
    one cloud has cached of a slot stays valid, and clouds do not wait for each other's locks. Other
    requests go to the first cloud.

    A request that one cloud does not answer goes to the next: each request may be repeated, as the
    cloud stores each message once. Where all fail, the last failure counts. A cloud that failed is
    left out for some seconds, twice as long each time, unless all are.

    Args:
        urls: The ingest of each cloud, in the order in which they are tried.
        headers: Returns the headers of a request.
        context: Holds the root certificate, and presents the gateway's certificate.
        timeout_s: Seconds to wait.
        abortable: Whether `abort` ends a request. Each request then has its own connection.
        transport: Carries requests in the place of TCP, for example to a cloud in this process.
        clock: Monotonic seconds.

    Attributes:
        clouds: How many there are.
    """

    def __init__(
        self,
        urls: Sequence[str],
        *,
        headers: Callable[[], dict[str, str]],
        context: ssl.SSLContext,
        timeout_s: float,
        abortable: bool = False,
        transport: httpx.BaseTransport | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._urls = [httpx.URL(url) for url in urls]
        self.clouds = len(urls)
        # By name, so that gateways agree whatever order each was given.
        self._by_name = sorted(range(self.clouds), key=urls.__getitem__)
        self._outages: dict[int, _Outage] = {}
        self._clock = clock
        self._headers = headers
        self._timeout_s = timeout_s
        limits = httpx.Limits(max_keepalive_connections=0 if abortable else None)
        # Proxies of the environment are ignored: a gateway connects to its cloud directly.
        self._client = httpx.Client(
            verify=context, trust_env=False, limits=limits, transport=transport
        )
        self._extensions = {"trace": self._note_connection} if abortable else {}
        self._connection: socket.socket | None = None
        self._aborted = False

    def abort(self) -> None:
        """End the open request and all later ones, from another thread."""
        self._aborted = True
        self._shut_down()

    def close(self) -> None:
        """Close all connections."""
        self._client.close()

    @property
    def url(self) -> str:
        """The ingest of the cloud that is tried first."""
        return str(self._urls[self._in_order(None)[0]])

    def post(
        self, resource: str, body: bytes, *, slot: int | None = None, wait_s: float = 0.0
    ) -> bytes:
        """Post a body and return that of the response.

        Args:
            resource: Its name, such as ``ingest``.
            body: CBOR.
            slot: Of the nodes whose messages it has: the cloud of this slot is tried first.
            wait_s: Seconds for which the cloud may hold the response back.

        Raises:
            CloudError: There is no response, or its status is not 200, or it is too long.
        """
        order = self._in_order(slot)
        for chosen, following in zip(order, [*order[1:], None], strict=True):
            try:
                url = self._urls[chosen].join(resource)
                answer = self._post(url, body, wait_s, self._connect_s(chosen))
            except CloudError as error:
                if self._aborted or not _is_of_one_cloud(error):
                    raise
                self._leave_out(chosen, following, error)
                # A request that was not answered in time may be at fault itself.
                if following is None or error.unanswered:
                    raise
            else:
                self._outages.pop(chosen, None)
                return answer
        raise AssertionError("there is a cloud")

    def _in_order(self, slot: int | None) -> list[int]:
        """The clouds in the order in which they are tried for a slot; those left out at last."""
        if slot is None:
            order = list(range(self.clouds))
        else:
            first = even_groups(self.clouds)[slot]
            order = self._by_name[first:] + self._by_name[:first]
        now = self._clock()
        outages = dict(self._outages)  # another thread may change them
        return sorted(order, key=lambda each: each in outages and outages[each].until > now)

    def _connect_s(self, chosen: int) -> float:
        if self.clouds == 1:
            return self._timeout_s
        return min(self._timeout_s, _CONNECT_AGAIN_S if chosen in self._outages else _CONNECT_S)

    def _leave_out(self, failed: int, following: int | None, error: CloudError) -> None:
        now, before = self._clock(), self._outages.get(failed)
        if self.clouds == 1 or (before is not None and before.until > now):
            return
        least, most = _LEFT_OUT_S
        seconds = least if before is None else min(2 * before.seconds, most)
        self._outages[failed] = _Outage(now + seconds, seconds)
        if following is not None:
            log.warning(
                "cloud failed, going on with the next: url=%s next=%s for_s=%g reason=%s",
                self._urls[failed],
                self._urls[following],
                seconds,
                error,
            )

    def _post(self, url: httpx.URL, body: bytes, wait_s: float, connect_s: float) -> bytes:
        received = bytearray()
        try:
            with self._client.stream(
                "POST",
                url,
                content=body,
                headers=self._headers(),
                timeout=httpx.Timeout(
                    self._timeout_s, connect=connect_s, read=self._timeout_s + wait_s
                ),
                extensions=self._extensions,
            ) as response:
                _require_ok(response)
                for part in response.iter_bytes():
                    received += part
                    if len(received) > MAX_RESPONSE:
                        raise CloudError(f"{url}: response exceeds {MAX_RESPONSE} bytes")
        except httpx.HTTPError as error:
            raise CloudError(
                f"{url}: {type(error).__name__}: {error}",
                unanswered=isinstance(error, httpx.ReadTimeout),
            ) from error
        finally:
            connection, self._connection = self._connection, None
            if connection is not None:
                connection.close()
        return bytes(received)

    def _note_connection(self, event: str, info: Mapping[str, Any]) -> None:
        if event == "connection.connect_tcp.complete":
            # The TLS handshake takes the socket itself away from the stream.
            self._connection = info["return_value"].get_extra_info("socket").dup()
            if self._aborted:
                self._shut_down()

    def _shut_down(self) -> None:
        connection = self._connection
        if connection is not None:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)


@contextmanager
def parsing(body: bytes) -> Iterator[None]:
    """Raise `CloudError` if a response cannot be parsed."""
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
        raise CloudError(f"invalid response of the cloud: {body[:100]!r}: {error}") from error


def _is_of_one_cloud(error: CloudError) -> bool:
    """Whether another cloud may answer: there was no answer, or that of a cloud that fails."""
    return error.status is None or error.status in _FAILS


def _require_ok(response: httpx.Response) -> None:
    if response.status_code != httpx.codes.OK:
        raise CloudError(
            f"{response.url} answered {response.status_code} {response.reason_phrase}",
            status=response.status_code,
            retry_after=_retry_after(response.headers.get("Retry-After")),
        )


def _retry_after(value: str | None) -> float | None:
    """Seconds of a Retry-After: a number, or a date (RFC 9110, section 10.2.3)."""
    if value is None:
        return None
    if value.isascii() and value.isdigit():
        return float(value[:9])
    try:
        return max(0.0, parsedate_to_datetime(value).timestamp() - time.time())
    except (ValueError, OverflowError):
        return None
