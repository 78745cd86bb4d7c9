"""A browser page that remembers what went wrong in it."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Error as PlaywrightError

from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import (
        Browser,
        BrowserContext,
        ConsoleMessage,
        Page,
        Playwright,
        Request,
        Route,
    )

ARGUMENTS: Final = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
CHART: Final = "[data-testid=chart]"
SOURCE: Final = Path(__file__).parents[3] / "cloud" / "dashboard" / "src"
PHONE: Final = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
PATIENCE_MS: Final = 60_000
"""As long as `wait_until` waits: a page takes its time where others need the machine, too."""
_VIOLATIONS: Final = """
addEventListener("securitypolicyviolation", (event) =>
  console.error(`CSP violation: ${event.violatedDirective} ${event.blockedURI}`));
"""
_FRAMES: Final = "() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)))"


def launch(playwright: Playwright) -> Browser:
    """Start Chromium; fails, with what to do, where there is none."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.fail("no Chromium on this machine; `make system` installs it (Debian: chromium)")
    return playwright.chromium.launch(executable_path=found, args=list(ARGUMENTS))


def history(place: str, start: int, end: int) -> str:
    """The address of a stretch of time (ns since 1970) of a place."""
    return f"{place}?from={format_timestamp(start)}&to={format_timestamp(end)}"


def without_events(route: Route) -> None:
    """Answer that there are none: peaks are painted over the band, and can be pointed at."""
    route.fulfill(json={"items": [], "next": None})


class Visit:
    """One page of the dashboard.

    Attributes:
        page: Playwright's page.
        troubles: Console errors, uncaught errors and violations of the content security policy.
        hosts: Those that it sent requests to.
        requests: The addresses of all its requests, in their order.
    """

    def __init__(self, context: BrowserContext, url: str) -> None:
        self.url = url
        self.troubles: list[str] = []
        self.hosts: set[str | None] = set()
        self.requests: list[str] = []
        self._unanswered: set[Request] = set()
        self.page: Page = context.new_page()
        self.page.add_init_script(_VIOLATIONS)
        self.page.on("console", self._on_console)
        self.page.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.page.on("request", self._on_request)
        self.page.on("requestfinished", self._on_answer)
        self.page.on("requestfailed", self._on_answer)

    def _on_request(self, request: Request) -> None:
        self.hosts.add(urlsplit(request.url).hostname)
        self.requests.append(request.url)
        if "/api/v1/live" not in request.url:  # whose answer has no end
            self._unanswered.add(request)

    def _on_answer(self, request: Request) -> None:
        self._unanswered.discard(request)

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.troubles.append(message.text)

    def open(self, fragment: str, *, shows: str = CHART) -> None:
        """Go to a place of the dashboard, and wait for what it shows there."""
        self.page.goto(f"{self.url}/#/{fragment}")
        self.page.locator(shows).first.wait_for()

    def wait_for_frame(self) -> None:
        """Wait until the browser has laid the page out once more, and painted it."""
        self.page.evaluate(_FRAMES)

    def asked(self, part: str) -> int:
        """How many requests were sent so far whose address has such a part."""
        self.page.evaluate("0")  # takes in what the browser stated meanwhile
        return sum(part in url for url in self.requests)

    def wait_for_answers(self) -> None:
        """Wait until all is there that the page has asked for: what comes later moves the rest."""
        self.wait_for_frame()
        asked = set(self._unanswered)

        def answered() -> bool:
            self.wait_for_frame()
            return asked.isdisjoint(self._unanswered)

        wait_until(answered, "all is there that the page has asked for")

    def chart(self) -> dict[str, str]:
        """What the first chart says of itself."""
        facts: dict[str, str] = self.page.locator(CHART).first.evaluate(
            "(root) => ({...root.dataset})"
        )
        return facts

    def newest(self) -> int:
        """Where what the first chart painted ends, ns since 1970; 0 before it painted."""
        return int(self.chart().get("newest") or 0)

    def wait_for_chart(self, seconds: float = 60.0, **facts: str) -> dict[str, str]:
        """Wait until the first chart says so, and has painted it."""

        def painted() -> bool:
            said = self.chart()
            return "xMin" in said and facts.items() <= said.items()

        wait_until(painted, f"a painted chart with {facts}", seconds=seconds)
        wait_until(lambda: self.page.locator(".panel.busy").count() == 0, "no panel loads")
        self.wait_for_frame()
        return self.chart()

    def window(self) -> tuple[int, int] | None:
        """The stretch of time (ns since 1970) that the address names; a live one has none."""
        # Asked of the page itself: `page.url` is not updated while we wait.
        query = parse_qs(self.page.evaluate("location.hash").partition("?")[2])
        if "from" not in query:
            return None
        return parse_timestamp(query["from"][0]), parse_timestamp(query["to"][0])

    def wait_for_window(self, before: tuple[int, int] | None) -> tuple[int, int]:
        """Wait until the address names another window, and the first chart has painted it."""
        wait_until(lambda: self.window() not in (None, before), f"another window than {before}")

        def settled() -> bool:
            said = self.chart()
            # A chart that is there may have painted nothing yet.
            return "xMin" in said and self.window() == (int(said["xMin"]), int(said["xMax"]))

        wait_until(settled, "the chart paints the window of the address")
        window = self.window()
        assert window is not None
        return window

    def wait_for_path(self, path: str) -> None:
        """Wait until the address has this path; a page that is just leaving answers nothing."""

        def there() -> bool:
            try:
                return bool(self.page.evaluate("location.pathname") == path)
            except PlaywrightError:
                return False

        wait_until(there, f"the address is {path}")

    def evaluate(self, script: str, argument: Any = None) -> Any:
        """The result of a script in the page."""
        return self.page.evaluate(script, argument)


@contextmanager
def visiting(browser: Browser, url: str, **options: Any) -> Iterator[Visit]:
    """A page in a context of its own."""
    context = browser.new_context(**options)
    context.set_default_timeout(PATIENCE_MS)
    try:
        visit = Visit(context, url)
        try:
            yield visit
        finally:
            # What a route still answers when its page is closed fails in the midst of another test.
            visit.page.unroute_all(behavior="ignoreErrors")
    finally:
        context.close()
