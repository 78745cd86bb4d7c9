"""What a screen reader hears of a page: the browser's own accessibility tree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.unit.dashboard.browsing import Visit

NAMED: Final = frozenset(
    {
        *("link", "button", "DisclosureTriangle", "checkbox", "radio", "switch", "slider"),
        *("textbox", "searchbox", "spinbutton", "combobox", "listbox", "option", "menuitem"),
        *("group", "form", "region", "toolbar", "navigation", "complementary", "radiogroup"),
        *("img", "image", "figure", "Canvas", "SvgRoot", "graphics-document", "graphics-symbol"),
        *("meter", "progressbar", "dialog", "table", "grid"),
    }
)
"""Roles that say nothing without a name."""


class Spoken(NamedTuple):
    """What is said of one element: its role, its name, and whether the focus may come to it."""

    role: str
    name: str
    focusable: bool


def listen(visit: Visit) -> list[Spoken]:
    """All that a screen reader finds on the page, in its order."""
    session = visit.page.context.new_cdp_session(visit.page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    return [
        Spoken(
            role=node["role"]["value"],
            name=node.get("name", {}).get("value", "").strip(),
            focusable=any(
                one["name"] == "focusable" and one["value"]["value"]
                for one in node.get("properties", ())
            ),
        )
        for node in nodes
        if not node["ignored"]
    ]


def listen_until(
    visit: Visit, condition: Callable[[list[Spoken]], bool], what: str
) -> list[Spoken]:
    """All that a screen reader finds once that fulfils a condition; fails with its name."""
    heard: list[Spoken] = []

    def fulfilled() -> bool:
        heard[:] = listen(visit)
        return condition(heard)

    wait_until(fulfilled, what)
    return heard


def nameless(heard: list[Spoken]) -> dict[str, str]:
    """What should have a name and has none, by its role or as the focus comes to it; after what."""
    return {
        f"{one.role} {index}": f"after {heard[index - 1].role} {heard[index - 1].name!r}"
        for index, one in enumerate(heard)
        if not one.name and (one.focusable or one.role in NAMED)
    }
