"""Asking the cloud over HTTPS whether it still has what it confirmed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol

import cbor2
import httpx
import orjson

from eskin.errors import CloudError
from gateway.refusal import require_ok

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Sequence

_AT_ONCE: Final = 5000


class Confirmations(Protocol):
    """What the gateway needs of the cloud to notice that its store is an older copy."""

    def compare(self, confirmed: Sequence[tuple[str, int, int]]) -> list[tuple[str, int, int, int]]:
        """State where each boot ended; learn what is missing of it.

        Args:
            confirmed: Node, boot, and the greatest number of it that the cloud confirmed.

        Returns:
            Node, boot, first and last number of what the cloud does not have.

        Raises:
            CloudError: The cloud did not answer as agreed.
        """


class HttpsConfirmations:
    """The cloud's ``confirmed`` over HTTPS.

    Args:
        url: The cloud's ingest; ``confirmed`` is beside it.
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
        self._url = httpx.URL(url).join("confirmed")
        self._headers = headers
        self._client = httpx.Client(verify=context, timeout=timeout_s, trust_env=False)

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def compare(self, confirmed: Sequence[tuple[str, int, int]]) -> list[tuple[str, int, int, int]]:
        """See `Confirmations.compare`."""
        missing = []
        for begin in range(0, len(confirmed), _AT_ONCE):
            missing += self._ask(confirmed[begin : begin + _AT_ONCE])
        return missing

    def _ask(self, confirmed: Sequence[tuple[str, int, int]]) -> list[tuple[str, int, int, int]]:
        body = cbor2.dumps([list(each) for each in confirmed])
        try:
            answer = self._client.post(self._url, content=body, headers=self._headers())
            require_ok(answer)
            return [_range(item) for item in orjson.loads(answer.content)["items"]]
        except httpx.HTTPError as error:
            raise CloudError(f"{self._url}: {type(error).__name__}: {error}") from error
        except (orjson.JSONDecodeError, KeyError, TypeError, ValueError) as error:
            raise CloudError(f"{self._url}: the answer is not as agreed") from error


def _range(item: dict[str, Any]) -> tuple[str, int, int, int]:
    return str(item["node"]), int(item["boot"]), int(item["first"]), int(item["last"])
