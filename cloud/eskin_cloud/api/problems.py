"""How the cloud answers errors, and the problem types of its own (RFC 9457)."""

from __future__ import annotations

import logging
from typing import Any, Final

from eskin.errors import CommandError, QueryError, StoreError
from eskin.runtime.http_server.problems import Problems, Refusal, documented
from eskin_cloud.commands.issue import BacklogError
from eskin_cloud.ingest.errors import (
    BatchTooLargeError,
    BatchTypeError,
    MalformedBatchError,
    UntrustedGatewayError,
)
from eskin_cloud.privacy.key_access import BiometricAccessError, ErasedError
from eskin_cloud.query.opaque_ids import UnknownCursorError
from eskin_cloud.store.read.lookup import UnknownChannelError

PROBLEMS: Final = Problems(
    {
        UnknownChannelError: Refusal(404, kind="unknown-resource"),
        UnknownCursorError: Refusal(422, kind="unknown-cursor"),
        QueryError: Refusal(422, kind="invalid-query"),
        CommandError: Refusal(422, kind="invalid-command"),
        BacklogError: Refusal(409, kind="command-backlog"),
        StoreError: Refusal(503, kind="store-unavailable", level=logging.ERROR),
        # A renewed certificate is shown by another connection.
        UntrustedGatewayError: Refusal(
            403, kind="untrusted-gateway", headers={"Connection": "close"}, limited=True
        ),
        BatchTooLargeError: Refusal(413, level=logging.WARNING),
        BatchTypeError: Refusal(415, level=logging.WARNING),
        MalformedBatchError: Refusal(422, kind="malformed-batch", level=logging.WARNING),
        BiometricAccessError: Refusal(403, kind="biometric-access"),
        ErasedError: Refusal(410, kind="erased-subject"),
    },
    hint="/openapi.json lists what is",
    remedies={
        "unknown-resource": "No node, channel, command, token or session has this name. List "
        "those that exist, and check the spelling.",
        "invalid-query": "A parameter of the query is not valid. The detail names it; correct it.",
        "unknown-cursor": "No cloud on this store has issued the cursor: it is of another store, "
        "or of one that was replaced. Begin without a cursor.",
        "invalid-command": "The command or one of its arguments is not valid for this node. The "
        "detail names what is allowed.",
        "command-backlog": "Too many commands wait for this node. Wait until it has answered some.",
        "store-unavailable": "The store cannot be read or written now. Retry after the time that "
        "Retry-After gives; if it lasts, see the server's log.",
        "untrusted-gateway": "The certificate is not one of a gateway of this site, or it expired "
        "or was revoked. Renew it, and connect again.",
        "malformed-batch": "The gateway's body or header does not follow the format. Do not send "
        "it again unchanged.",
        "biometric-access": "The channel is biometric. Use a token with the scope biometric, at a "
        "cloud that holds the subjects' keys.",
        "erased-subject": "The subject's key was destroyed, so its data cannot be read again. Do "
        "not retry.",
        "missing-scope": "The token or session lacks a scope. Use one that has the scope that the "
        "detail names.",
        "revoked-token": "The token or session was revoked while it was used. Use another one.",
        "cross-site-request": "A browser sent the request from a page of another site. Send it "
        "from the dashboard, or with a token.",
    },
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
