"""How the CA service answers errors: the types of its own (RFC 9457)."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import Final

from eskin.errors import AuthorityError, IdentityError, LockedError
from eskin.runtime.http_server.problems import Problems, Refusal
from eskin_ca.issuance_quota import IssuanceQuotaError

REFUSALS: Final = {HTTPStatus.FORBIDDEN, HTTPStatus.UNPROCESSABLE_ENTITY}
"""Answers to clients that may be guessing tokens."""
_AGAIN: Final = {"Retry-After": "10"}
"""The request is good, and may come again."""

PROBLEMS: Final = Problems(
    {
        IssuanceQuotaError: Refusal(429, headers=_AGAIN, level=logging.WARNING),
        LockedError: Refusal(
            503, "the CA is being changed; come again", headers=_AGAIN, level=logging.WARNING
        ),
        AuthorityError: Refusal(
            503,
            "the CA cannot be used until its operator has looked at it; come again",
            headers=_AGAIN,
            level=logging.ERROR,
        ),
        IdentityError: Refusal(403, limited=True),
    },
    hint="see docs/pki.md",
)
