"""How the cloud answers errors: the types of its own (RFC 9457)."""

from __future__ import annotations

import logging
from typing import Final

from eskin.errors import CommandError, QueryError, StoreError
from eskin.runtime.http_server.problems import Problems, Refusal
from eskin_cloud.commands.errors import BacklogError
from eskin_cloud.ingest.errors import (
    BatchTooLargeError,
    BatchTypeError,
    MalformedBatchError,
    UntrustedGatewayError,
)
from eskin_cloud.privacy.errors import ErasedError
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
        ErasedError: Refusal(410),
    },
    hint="/openapi.json lists what is",
)
