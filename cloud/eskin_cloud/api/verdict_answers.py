"""Answers of formulas over stored channels: stretches page by page, and totals."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import QueryError
from eskin.interval import Verdict
from eskin.monitor import horizon
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import opened
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.query.verdict_totals import total_verdicts
from eskin_cloud.rollup.hulls import widest_window
from eskin_cloud.schemas.base import page
from eskin_cloud.schemas.monitors import FormulaTotalsDocument, describe_totals, describe_verdict
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window, make_window, parse_window

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from sqlalchemy import Connection
    from starlette.responses import Response

    from eskin.monitor import Formula
    from eskin_cloud.api.dependencies import Access
    from eskin_cloud.api.window_params import PagedWindowQuery, WindowQuery
    from eskin_cloud.app_state import AppState
    from eskin_cloud.query.stored_verdicts import StoredPiece
    from eskin_cloud.store.read.lookup import Channel

    Places = Mapping[str, tuple[str, str]]

_MOST_READS: Final = 20_000
"""Stretches that are evaluated for totals, which are answered at once."""


def list_verdicts(
    cloud: AppState,
    access: Access,
    formula: Formula,
    places: Places,
    query: PagedWindowQuery,
    *,
    wanted: Callable[[StoredPiece], bool] | None = None,
) -> Response:
    """A page of the stretches of a window.

    Args:
        cloud: The cloud.
        access: Of the caller.
        formula: What is evaluated.
        places: Node and channel of each channel that it measures, by its name in the formula.
        query: The window, and which page of it.
        wanted: Which stretches are listed; ``None`` for those in which it holds, or may hold by
            samples that exist.

    Raises:
        QueryError: The formula does not fit its channels, or a parameter is invalid.
        NotFoundError: A channel is unknown.
    """
    with cloud.store.read() as connection:
        rows = {name: find_channel(connection, *place) for name, place in places.items()}
        if query.cursor is None:
            window = _window(cloud, rows, query)
            first = 2 * window.start
        else:
            # A cursor holds the window, too: new data must not move a default one.
            first, end = cloud.feed.ids.read(query.cursor, 2)
            window = make_window(first // 2, end)
        with _sources(cloud, access, connection, rows, formula, window) as sources:
            pieces = StoredVerdicts(formula, sources).pieces(window)
            rest = (each for each in pieces if each.last >= first)
            found, following = _paged(rest, first, window, query.limit, wanted or _may_hold)
    cursor = None if following is None else cloud.feed.ids.write(following, window.end)
    return as_json(page([describe_verdict(each) for each in found], cursor))


def total_time(
    cloud: AppState,
    access: Access,
    formula: Formula,
    places: Places,
    query: WindowQuery,
) -> FormulaTotalsDocument:
    """For how long, and how often, a formula holds in a window; arguments as `list_verdicts`.

    Raises:
        QueryError: As `list_verdicts`, or too much of the window stays open.
    """
    with cloud.store.read() as connection:
        rows = {name: find_channel(connection, *place) for name, place in places.items()}
        window = _window(cloud, rows, query)
        with _sources(cloud, access, connection, rows, formula, window) as sources:
            verdicts = StoredVerdicts(formula, sources, most_reads=_MOST_READS)
            found = total_verdicts(verdicts.pieces(window))
    if verdicts.reads > _MOST_READS:
        raise QueryError("start, end", "too many stretches are open; choose a shorter window")
    totals = describe_totals(found, window, verdicts.coverage)
    return FormulaTotalsDocument(**totals.model_dump(), false_a_year=verdicts.false_a_year)


def _may_hold(piece: StoredPiece) -> bool:
    return piece.verdict is not Verdict.IMPOSSIBLE and not piece.missing


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
    """Where the channels are read; what is stored of a sealed one is not what its frames hold."""
    past, future = horizon(formula)
    around = widest_window(Window(window.start - (past or 0), window.end + (future or 0)))
    with ExitStack() as stack:
        yield {
            name: ChannelSource(
                *stack.enter_context(opened(cloud, access, connection, row, around))
            )
            for name, row in rows.items()
        }


def _paged(
    pieces: Iterator[StoredPiece],
    first: int,
    window: Window,
    limit: int,
    wanted: Callable[[StoredPiece], bool],
) -> tuple[list[StoredPiece], int | None]:
    """The first stretches from a tick on, and the tick at which the rest of the window begins."""
    following = first
    found: list[StoredPiece] = []
    for piece in pieces:
        listed = wanted(piece)
        if listed and len(found) == limit:
            return found, max(piece.first, first)
        following = piece.last + 1
        found += [piece._replace(first=max(piece.first, first))] * listed
    return found, None if following >= 2 * window.end else following
