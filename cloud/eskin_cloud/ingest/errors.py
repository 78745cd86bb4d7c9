"""Batches that are refused as a whole.

EskinError
└── IngestError
    ├── UntrustedGatewayError   its certificate is none of a gateway of ours, or no more
    ├── BatchTooLargeError      the body is longer than allowed
    ├── BatchTypeError          the body is not declared as CBOR
    └── MalformedBatchError     the body is no batch, or a header is not as agreed
"""

from __future__ import annotations

from eskin.errors import EskinError


class IngestError(EskinError):
    """A batch that is refused as a whole."""


class UntrustedGatewayError(IngestError):
    """The client's certificate is none of a gateway of ours, or no more."""


class BatchTooLargeError(IngestError):
    """The body is longer than allowed."""


class BatchTypeError(IngestError):
    """The body is not declared as CBOR."""


class MalformedBatchError(IngestError):
    """The body is no batch, or a header is not as agreed."""
