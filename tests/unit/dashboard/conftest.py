"""One recording, one demo and one browser for all tests of the dashboard.

Most tests open the recording (``visit``); those of sign-in, pixels, sums and silence open a demo
(``live_visit``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import pytest
from playwright.sync_api import sync_playwright

from eskin.wire.timestamp import parse_timestamp
from tests.support.demos import RunningDemo
from tests.unit.dashboard.browsing import Visit, launch, visiting
from tests.unit.dashboard.record import LENGTH_NS, NODES
from tests.unit.dashboard.replay import Replay

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser

DEFAULTS: Final = {
    "viewport": {"width": 1000, "height": 800},
    "color_scheme": "light",
    "reduced_motion": "reduce",  # charts move twice a second
}


@dataclass(frozen=True)
class Session:
    """What the browser holds after it has opened the login URL.

    Attributes:
        state: Cookies, for further contexts.
        landed: The URL that it ended at.
        title: The title of the page there.
        nodes: The nodes' names on that page.
    """

    state: Any
    landed: str
    title: str
    nodes: list[str]


@pytest.fixture(scope="package")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDemo]:
    """A demo of three nodes with some data."""
    with RunningDemo(tmp_path_factory.mktemp("demo") / "data", "--nodes", "3") as running:
        running.wait_for_more(NODES)
        yield running


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """A running Chromium."""
    with sync_playwright() as playwright:
        running = launch(playwright)
        yield running
        running.close()


@pytest.fixture(scope="package")
def session(demo: RunningDemo, browser: Browser) -> Session:
    """Signed in by the one-time login URL."""
    with visiting(browser, demo.access["url"]) as visit:
        page = visit.page
        page.goto(demo.login_url)
        page.locator("[data-testid=node]").nth(len(NODES) - 1).wait_for()
        names = page.locator("[data-testid=node]").evaluate_all(
            "(all) => all.map((one) => one.dataset.node)"
        )
        return Session(page.context.storage_state(), page.url, page.title(), names)


@pytest.fixture
def options() -> dict[str, Any]:
    """Options of the browser's context; tests replace it by parametrization."""
    return {}


@pytest.fixture(scope="package")
def replay() -> Iterator[Replay]:
    """A cloud with recorded answers."""
    with Replay() as running:
        yield running


def watched(browser: Browser, url: str, options: dict[str, Any]) -> Iterator[Visit]:
    """A page; afterwards nothing may have gone wrong in it."""
    with visiting(browser, url, **{**DEFAULTS, **options}) as opened:
        yield opened
        assert opened.troubles == []
        assert opened.hosts == {"127.0.0.1"}


@pytest.fixture
def visit(replay: Replay, browser: Browser, options: dict[str, Any]) -> Iterator[Visit]:
    """A page of the recording."""
    yield from watched(browser, replay.url, options)


@pytest.fixture
def live_visit(
    demo: RunningDemo, browser: Browser, session: Session, options: dict[str, Any]
) -> Iterator[Visit]:
    """A page of the demo, signed in."""
    signed_in = {"storage_state": session.state, **options}
    yield from watched(browser, demo.access["url"], signed_in)


@pytest.fixture(scope="package")
def recorded(replay: Replay) -> int:
    """An instant (ns) before which every node of the recording has 20 s of data."""
    return replay.start + 4 * LENGTH_NS


@pytest.fixture(scope="package")
def live_recorded(demo: RunningDemo) -> int:
    """An instant (ns) before which every node of the demo has 4 s of data at least."""

    def spans() -> list[tuple[int, int]]:
        channels = [c for node in NODES for c in demo.get(f"/nodes/{node}/channels")["items"]]
        return [(parse_timestamp(c["first"]), parse_timestamp(c["last"])) for c in channels]

    def end() -> int:
        return min(last for _, last in spans())

    demo.wait_for(
        lambda: end() - max(first for first, _ in spans()) > 4_000_000_000, "4 s of data are stored"
    )
    return end()
