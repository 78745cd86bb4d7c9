"""Tokens and sessions: who may do what."""

import asyncio
from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin_cloud.access import (
    Scope,
    create_token,
    digest,
    list_sessions,
    list_tokens,
    revoke_session,
    revoke_token,
    token_id,
)
from eskin_cloud.api.dependencies import Administrator, CloudState
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.schemas.access import NewTokenDocument, SessionDocument, TokenDocument
from eskin_cloud.schemas.base import NoQuery, PageDocument
from eskin_cloud.store.read.lookup import UnknownChannelError

router = APIRouter(tags=["access"])


class TokenBody(BaseModel):
    """A token that is to be made."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    name: str = Field(min_length=1, max_length=100, description="whose it is, for people")
    scopes: list[Annotated[Scope, Field(strict=False)]] = Field(
        min_length=1, max_length=len(Scope), description="what its holder may do"
    )
    days: float = Field(default=30.0, gt=0, le=3650, description="days it is good")


@router.get("/tokens", responses=REFUSALS)
def get_tokens(
    cloud: CloudState, _: Administrator, query: Annotated[NoQuery, Query()]
) -> PageDocument[TokenDocument]:
    """List the tokens, also expired and revoked ones, without their secrets."""
    del query
    with cloud.store.read() as connection:
        rows = list_tokens(connection)
    now = cloud.clock()
    return PageDocument(items=[TokenDocument.of(row, now=now) for row in rows], next=None)


@router.post(
    "/tokens",
    status_code=201,
    responses=REFUSALS | documented(408, 413),
)
async def post_token(
    cloud: CloudState, access: Administrator, body: TokenBody, query: Annotated[NoQuery, Query()]
) -> NewTokenDocument:
    """Create a token; only this answer holds its secret."""
    del query
    token = await asyncio.to_thread(
        create_token,
        cloud.store,
        scopes=body.scopes,
        name=body.name,
        lifetime=timedelta(days=body.days),
        actor=access.actor,
    )
    return NewTokenDocument(id=token_id(digest(token)), token=token)


@router.delete("/tokens/{id}", status_code=204, responses=REFUSALS | documented(404))
async def delete_token(
    cloud: CloudState,
    access: Administrator,
    id: str,  # noqa: A002 - the path's name for it
    query: Annotated[NoQuery, Query()],
) -> Response:
    """Revoke a token, and end the sessions that it opened."""
    del query
    done = await asyncio.to_thread(revoke_token, cloud.store, id, actor=access.actor)
    if not done:
        raise UnknownChannelError("id", f"{id[:40]!r} is no token that could be revoked")
    return Response(status_code=204)


@router.get("/sessions", responses=REFUSALS)
def get_sessions(
    cloud: CloudState, _: Administrator, query: Annotated[NoQuery, Query()]
) -> PageDocument[SessionDocument]:
    """List the valid sessions of browsers."""
    del query
    with cloud.store.read() as connection:
        rows = list_sessions(connection, now=cloud.clock())
    return PageDocument(items=[SessionDocument.model_validate(row) for row in rows], next=None)


@router.delete("/sessions/{id}", status_code=204, responses=REFUSALS | documented(404))
async def delete_session(
    cloud: CloudState,
    access: Administrator,
    id: str,  # noqa: A002 - the path's name for it
    query: Annotated[NoQuery, Query()],
) -> Response:
    """Revoke a session, and end its open requests and streams."""
    del query
    done = await asyncio.to_thread(revoke_session, cloud.store, id, actor=access.actor)
    if not done:
        raise UnknownChannelError("id", f"{id[:40]!r} is no session that could be revoked")
    return Response(status_code=204)
