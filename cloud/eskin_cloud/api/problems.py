"""How the cloud answers errors: the types of its own (RFC 9457)."""

from __future__ import annotations

import logging
from typing import Any, Final

from eskin.errors import CommandError, QueryError, StoreError
from eskin.runtime.http_server.problems import Problems, Refusal, documented
from eskin_cloud.commands.errors import BacklogError
from eskin_cloud.ingest.errors import (
    BatchTooLargeError,
    BatchTypeError,
    MalformedBatchError,
    UntrustedGatewayError,
)
from eskin_cloud.privacy.errors import BiometricAccessError, ErasedError
from eskin_cloud.store.read.errors import UnknownChannelError

PROBLEMS: Final = Problems(
    {
        UnknownChannelError: Refusal(404),
        QueryError: Refusal(422),
        CommandError: Refusal(422),
        BacklogError: Refusal(409),
        StoreError: Refusal(503, level=logging.ERROR),
        # A renewed certificate is shown by another connection.
        UntrustedGatewayError: Refusal(403, headers={"Connection": "close"}, limited=True),
        BatchTooLargeError: Refusal(413, level=logging.WARNING),
        BatchTypeError: Refusal(415, level=logging.WARNING),
        MalformedBatchError: Refusal(422, level=logging.WARNING),
        BiometricAccessError: Refusal(403),
        ErasedError: Refusal(410),
    },
    hint="/openapi.json lists what is",
)

REFUSALS: Final[dict[int | str, dict[str, Any]]] = documented(401, 403, 422, 429, 503)
"""What every question may be answered with."""
REFUSALS_OF_PLACE: Final[dict[int | str, dict[str, Any]]] = documented(
    401, 403, 404, 410, 422, 429, 503
)
"""What a question about a node or a channel may be answered with."""

CBOR_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {"application/cbor": {"schema": {"type": "string", "format": "binary"}}},
    },
    "security": [{"gateway": []}],
}
"""The description of what gateways post."""
