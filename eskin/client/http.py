"""Asking the cloud, again where the network or the cloud fails for a while."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

import httpx

from eskin.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

API: Final = "/api/v1"
_TRIES: Final = 6
_PASSING: Final = frozenset({429, 502, 503, 504})
"""Statuses that may be better an instant later."""
_LONGEST_S: Final = 30.0


class HttpClient:
    """A connection to one cloud; a request that fails in passing is repeated.

    Args:
        http: Knows the cloud's address and the token.
        retry_s: Seconds before the first repetition; each further one waits twice as long.
    """

    def __init__(self, http: httpx.Client, *, retry_s: float) -> None:
        self._http = http
        self._retry_s = retry_s

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def get(
        self, path: str, params: Mapping[str, Any] | None = None, *, accept: str
    ) -> httpx.Response:
        """Ask once, or until it is answered.

        Raises:
            CloudError: It was refused, or not answered.
        """
        return self._send("GET", path, params=params, headers={"Accept": accept})

    def put(self, path: str, body: Mapping[str, Any]) -> httpx.Response:
        """Have something be so; it may be sent several times until it is answered.

        Raises:
            CloudError: It was refused, or not answered.
        """
        return self._send("PUT", path, json=body)

    def _send(self, method: str, path: str, **options: Any) -> httpx.Response:
        fault = ""
        for attempt in range(_TRIES):
            if attempt:
                time.sleep(min(_LONGEST_S, self._retry_s * 2 ** (attempt - 1)))
            try:
                answer = self._http.request(method, path, **options)
            except httpx.TransportError as error:
                fault = f"{type(error).__name__}: {error}"
                continue
            if answer.is_success:
                return answer
            if answer.status_code not in _PASSING:
                raise CloudError(_detail(answer), status=answer.status_code)
            fault = _detail(answer)
        raise CloudError(f"{self._http.base_url} did not answer in {_TRIES} tries: {fault}")

    def items(self, path: str, params: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
        """All items of a list, page by page."""
        cursor: str | None = None
        while True:
            asked = dict(params or {}) | ({} if cursor is None else {"cursor": cursor})
            body = self.get(path, asked, accept="application/json").json()
            yield from body["items"]
            cursor = body["next"]
            if cursor is None:
                return

    def following(
        self, path: str, params: Mapping[str, Any], *, accept: str
    ) -> Iterator[httpx.Response]:
        """A page, and all that its ``Link`` headers lead to."""
        answer = self.get(path, params, accept=accept)
        yield answer
        while (link := answer.links.get("next")) is not None:
            answer = self.get(link["url"], accept=accept)
            yield answer


def _detail(answer: httpx.Response) -> str:
    """What problem details say."""
    try:
        return f"{answer.status_code}: {answer.json()['detail']}"
    except (ValueError, KeyError, TypeError):
        return f"{answer.status_code} {answer.reason_phrase}"
