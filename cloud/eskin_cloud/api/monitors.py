"""Formulas over stored channels."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.errors import MonitorError, QueryError
from eskin.interval import Verdict
from eskin.monitor import Formula, parse
from eskin.wire.messages.command_schema import MOST_FORMULA
from eskin_cloud.api.dependencies import Access, CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import WindowQuery, opened, resumed
from eskin_cloud.app_state import AppState
from eskin_cloud.query.cursors import write_cursor
from eskin_cloud.query.neighbourhood import ChannelSource
from eskin_cloud.query.stored_verdicts import StoredPiece, StoredVerdicts
from eskin_cloud.rollup.hulls import widest_window
from eskin_cloud.schemas.base import PageDocument, page
from eskin_cloud.schemas.monitors import VerdictDocument, describe_verdict
from eskin_cloud.store.read.lookup import Channel, find_channel
from eskin_cloud.store.read.window import Window, parse_window

router = APIRouter(tags=["monitors"])

_MOST_CHANNELS = 16


class EvaluationQuery(WindowQuery):
    """A formula, and where its channels are; without a window, the last minute of their data."""

    formula: str = Field(
        min_length=1,
        max_length=MOST_FORMULA,
        description="signal temporal logic over channels, with bounded windows",
        examples=["always[0,50ms](t01.capacitance > 50 pF)"],
    )
    node: str | None = Field(
        default=None,
        max_length=63,
        description='of channels without one; others are "NODE/CHANNEL", in double quotes',
    )
    verdict: Literal["impossible", "possible", "certain"] | None = Field(
        default=None, description="only stretches with this one"
    )
    limit: int = Field(default=1000, ge=1, le=10_000, description="stretches at once")
    cursor: str | None = Field(default=None, max_length=1000, description="what `next` said")


@router.get(
    "/monitors/evaluation",
    response_model=PageDocument[VerdictDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_evaluation(
    cloud: CloudState, access: Reader, query: Annotated[EvaluationQuery, Query()]
) -> Response:
    """List when a formula over stored channels is certain, possible and impossible.

    Hulls of the pyramid are read first, and samples only where those do not decide. A page may be
    short, or empty, with a ``next`` that continues: then much stays open, and the answer takes
    several requests.
    """
    formula = _formula(query.formula)
    with cloud.store.read() as connection:
        rows = _rows(connection, formula, query.node)
        window = _window(cloud, rows, query) if query.cursor is None else resumed(query.cursor)
        with _sources(cloud, access, connection, rows, formula, window) as sources:
            verdicts = StoredVerdicts(formula, sources)
            found, following = _paged(verdicts.pieces(window), window, query)
    return as_json(page([describe_verdict(each) for each in found], following))


def _formula(text: str) -> Formula:
    try:
        return parse(text)
    except MonitorError as error:
        raise QueryError("formula", str(error)) from error


def _rows(connection: Connection, formula: Formula, node: str | None) -> dict[str, Channel]:
    """The channels of a formula, by their names in it."""
    names = sorted(formula.channels)
    if not names:
        raise QueryError("formula", "reads no channel")
    if len(names) > _MOST_CHANNELS:
        raise QueryError("formula", f"reads {len(names)} channels; at most {_MOST_CHANNELS} may be")
    found = {}
    for name in names:
        own, slash, channel = name.rpartition("/")
        if not slash and node is None:
            raise QueryError(
                "node", f'is missing: {name} has no node; give one, or write "NODE/{name}"'
            )
        found[name] = find_channel(connection, own if slash else str(node), channel)
    return found


def _window(cloud: AppState, rows: dict[str, Channel], query: WindowQuery) -> Window:
    lasts = [row["t_last"] for row in rows.values() if row["t_last"] is not None]
    return parse_window(query.start, query.end, last=min(lasts, default=cloud.clock()))


@contextmanager
def _sources(
    cloud: AppState,
    access: Access,
    connection: Connection,
    rows: dict[str, Channel],
    formula: Formula,
    window: Window,
) -> Iterator[dict[str, ChannelSource]]:
    """Where the channels are read."""
    units = {name: ChannelSource(connection, row) for name, row in rows.items()}
    past, future = StoredVerdicts(formula, units).reach
    around = widest_window(Window(window.start - past, window.end + future))
    with ExitStack() as stack:
        yield {
            name: ChannelSource(
                *stack.enter_context(opened(cloud, access, connection, row, around))
            )
            for name, row in rows.items()
        }


def _paged(
    pieces: Iterator[StoredPiece], window: Window, query: EvaluationQuery
) -> tuple[list[StoredPiece], str | None]:
    """The first stretches that are asked for, and a cursor for what is left of the window."""
    reached = 2 * window.start - 1
    found: list[StoredPiece] = []
    for piece in pieces:
        wanted = query.verdict is None or piece.verdict is Verdict[query.verdict.upper()]
        if wanted and len(found) == query.limit:
            return found, write_cursor(piece.first // 2, window.end)
        reached = piece.last
        found += [piece] * wanted
    following = (reached + 1) // 2
    return found, None if following >= window.end else write_cursor(following, window.end)
