"""Telling the cloud of subjects over HTTPS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import cbor2
import httpx
import orjson

from eskin.errors import CloudError
from gateway.refusal import require_ok

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Sequence


class Notices(Protocol):
    """What the gateway needs of the cloud to have keys kept and destroyed."""

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        """Tell, and learn what became of each subject's key.

        It is kept, declined or erased; in ``conflict`` with another one that is kept; or not taken,
        as the cloud has no certificate of the node (``unknown_node``).

        Args:
            worn: Pseudonym, node, and the key if the cloud may have it.
            erased: Pseudonyms whose keys are to be destroyed.

        Raises:
            CloudError: The cloud did not answer as agreed.
        """


class HttpsNotices:
    """The cloud's subjects over HTTPS.

    Args:
        url: The cloud's ingest; subjects are beside it.
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
        self._url = httpx.URL(url).join("subjects")
        self._headers = headers
        self._client = httpx.Client(verify=context, timeout=timeout_s, trust_env=False)

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        """See `Notices.send`."""
        body = cbor2.dumps({"worn": [list(one) for one in worn], "erased": list(erased)})
        try:
            headers = self._headers()
            answer = self._client.post(self._url, content=body, headers=headers)
            require_ok(answer)
            items = orjson.loads(answer.content)["items"]
            # Of a subject at several nodes, what keeps one of them from being told is told.
            found: dict[str, str] = {item["id"]: item["result"] for item in items}
            hindered = [item for item in items if item["result"] in {"conflict", "unknown_node"}]
            return found | {item["id"]: item["result"] for item in hindered}
        except httpx.HTTPError as error:
            raise CloudError(f"{self._url}: {type(error).__name__}: {error}") from error
        except (orjson.JSONDecodeError, KeyError, TypeError) as error:
            raise CloudError(f"{self._url}: the answer is not as agreed") from error
