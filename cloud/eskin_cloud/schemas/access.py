"""Tokens, sessions, the audit log and subjects."""

from typing import Annotated, Any, Literal, Self

from pydantic import AliasChoices, BaseModel, BeforeValidator, Field

from eskin_cloud.access import token_id
from eskin_cloud.schemas.base import Instant, Row


def _split(scopes: Any) -> Any:
    return scopes.split() if isinstance(scopes, str) else scopes


Scopes = Annotated[list[Literal["read", "operate", "admin", "biometric"]], BeforeValidator(_split)]
"""Scopes; a model takes them as the store keeps them, too."""


class TokenDocument(BaseModel):
    """A token, without its secret."""

    id: str
    name: str
    scopes: Scopes
    state: Literal["good", "expired", "revoked"]
    created: Instant
    expires: Instant | None
    revoked: Instant | None

    @classmethod
    def of(cls, row: Row, *, now: int) -> Self:
        """A token's row."""
        state = "good" if row["expires"] is None or now < row["expires"] else "expired"
        state = state if row["revoked"] is None else "revoked"
        return cls.model_validate(dict(row) | {"id": token_id(row["digest"]), "state": state})


class SessionDocument(BaseModel):
    """A valid session, without its secret; ``name`` is its token's, or ``login link``."""

    id: str
    name: str
    scopes: Scopes
    expires: Instant


class NewTokenDocument(BaseModel):
    """A new token; no other answer holds its secret."""

    id: str
    token: str


class AuditEntryDocument(BaseModel):
    """An entry of the audit log."""

    id: int = Field(validation_alias=AliasChoices("number", "id"))
    time: Instant
    actor: str
    address: str
    action: str
    target: str
    detail: str
    digest: str


class SubjectDocument(BaseModel):
    """A subject, by pseudonym: the nodes it wore, the sealed messages held, when it was erased."""

    id: str
    site: str
    nodes: list[str]
    messages: int | None
    erased: Instant | None
