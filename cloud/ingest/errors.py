"""Batches that are refused as a whole.

EskinError
└── IngestError
    ├── UnauthenticatedError   the gateway does not prove who it is
    ├── BatchTooLargeError     the body is longer than allowed
    ├── BatchTypeError         the body is not said to be CBOR
    └── MalformedBatchError             the body is no batch
"""

from __future__ import annotations

from eskin.errors import EskinError


class IngestError(EskinError):
    """A batch that is refused as a whole."""


class UnauthenticatedError(IngestError):
    """The gateway does not prove who it is."""


class BatchTooLargeError(IngestError):
    """The body is longer than allowed."""


class BatchTypeError(IngestError):
    """The body is not said to be CBOR."""


class MalformedBatchError(IngestError):
    """The body is no batch."""
