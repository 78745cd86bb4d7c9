"""The page that the login URL opens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, PHONE, visiting
from tests.unit.dashboard.record import NODES

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.conftest import Session
    from tests.unit.dashboard.replay import Replay

PANELS = """
() => [...document.querySelectorAll("[data-testid=channel]")].map((panel) => {
  const chart = panel.querySelector("[data-testid=chart]").dataset;
  const value = panel.querySelector("[data-testid=channel-value]").textContent;
  const coverage = panel.querySelector(".coverage").textContent;
  const id = `${chart.node}/${chart.channel}`;
  return { id, end: chart.xMax, entries: chart.entries, value, coverage };
})
"""
TALL = {"viewport": {"width": 1280, "height": 3200}, "reduced_motion": "no-preference"}
CARDS = """
() => [...document.querySelectorAll("[data-testid=node]")].map((card) => {
  const names = [...card.querySelectorAll("dt")];
  const inner = (fact) => fact.lastElementChild ?? fact;
  const facts = names.map(({ textContent, nextElementSibling: fact }) =>
    [textContent, [fact.textContent, getComputedStyle(inner(fact)).color]]);
  const tight = ({ nextElementSibling: fact }) => fact.scrollWidth > fact.clientWidth;
  const cut = names.filter(tight).map((name) => name.textContent);
  return { node: card.dataset.node, cut, ...Object.fromEntries(facts) };
})
"""
"""Of each node's card its facts: what is written, and in which colour."""
CHARGE = {"stored": {"lo": 0.2, "hi": 0.3}, "charge": {"lo": 0.509, "hi": 0.601}}
WHOLE: dict[str, Any] = {"energy": None, "gaps": 0}
DRAINED: dict[str, Any] = {
    "fingertip": {
        "energy": CHARGE | {"self_sustaining": "possible", "shedding": "none"},
        "gaps": 3,
    },
    "palm": {
        "energy": CHARGE
        | {"charge": {"lo": None, "hi": 0.063}, "self_sustaining": "impossible"}
        | {"shedding": "peaks"},
        "gaps": 12345,
    },
}


def test_login_url_opens_the_dashboard(demo: RunningDemo, session: Session) -> None:
    assert session.landed.split("#")[0] == f"{demo.access['url']}/"
    assert session.title == "eskin"
    assert sorted(session.nodes) == sorted(NODES)


def test_login_url_opens_once(demo: RunningDemo, browser: Browser, session: Session) -> None:
    assert session.nodes
    with visiting(browser, demo.access["url"]) as visit:
        visit.page.goto(demo.login_url)
        assert "used already" in visit.page.locator("body").inner_text()


def test_nodes_are_shown_online(visit: Visit) -> None:
    visit.open("")
    for node in NODES:
        card = visit.page.locator(f"[data-testid=node][data-node={node}]")
        card.get_by_text("online", exact=True).wait_for()
        lag = card.get_by_test_id("node-lag")
        wait_until(lambda lag=lag: any(map(str.isdigit, lag.inner_text())), "its lag is stated")  # type: ignore[misc]  # mypy infers no lambda defaults


def test_gateway_and_store_are_shown_beside_all_nodes(replay: Replay, visit: Visit) -> None:
    visit.open("")
    (known,) = replay.get("/gateways")["items"]
    card = visit.page.locator(f"[data-gateway='{known['id']}']")
    card.get_by_text("online", exact=True).wait_for()
    assert known["spool"]["capacity_bytes"] > known["spool"]["bytes"]
    assert 0 < known["lag"]["lo_ns"] <= known["lag"]["hi_ns"]
    lag = card.get_by_test_id("gateway-lag")
    wait_until(lambda: any(map(str.isdigit, lag.inner_text())), "its lag is stated")
    each = visit.page.get_by_test_id("bytes-per-sample").inner_text()
    assert 1 < float(each.removesuffix(" B")) < 1000
    visit.page.locator("[data-testid=node]").first.click()
    card.wait_for(state="hidden")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{"viewport": {"width": 1280, "height": 800}}, PHONE])
def test_card_of_a_node_shows_its_battery_and_its_gaps(visit: Visit) -> None:
    def drain(route: Route) -> None:
        answer = route.fetch()
        items = answer.json()["items"]
        stated = [{**item, **DRAINED.get(item["id"], WHOLE)} for item in items]
        route.fulfill(response=answer, json={"items": stated, "next": None})

    visit.page.route("**/api/v1/nodes", drain)
    visit.open("")
    visit.page.get_by_test_id("node-energy").nth(1).wait_for()
    facts = {card["node"]: card for card in visit.evaluate(CARDS)}
    _, plain = facts["forearm"]["gaps"]
    _, warning = facts["fingertip"]["gaps"]
    assert warning != plain, "what is wrong is stated by its colour, too"
    assert facts["palm"]["battery"] == ["0–7 % · discharges · sheds to peaks", warning]
    assert facts["palm"]["gaps"] == ["12,345", warning]
    assert facts["fingertip"]["battery"] == ["50–61 % · may sustain itself", plain]
    assert facts["fingertip"]["gaps"] == ["3", warning]
    assert facts["forearm"]["gaps"] == ["0", plain]
    assert "battery" not in facts["forearm"]
    assert [card["cut"] for card in facts.values()] == [[], [], []]


@pytest.mark.parametrize("options", [TALL])
def test_every_channel_without_a_picture_has_a_live_chart_that_moves(
    replay: Replay, visit: Visit
) -> None:
    channels = [
        f"{node}/{channel['id']}"
        for node in NODES
        if node != "fingertip"  # shown as a picture
        for channel in replay.get(f"/nodes/{node}/channels")["items"]
    ]

    def panels() -> dict[str, dict[str, str]]:
        return {panel["id"]: panel for panel in visit.evaluate(PANELS)}

    visit.open("?live=5s")
    wait_until(
        lambda: (
            sorted(panels()) == sorted(channels)
            and all(int(panel["entries"] or 0) > 1 for panel in panels().values())
        ),
        "every channel has a chart with data",
    )
    before = panels()
    wait_until(
        lambda: all(int(now["end"]) > int(before[id_]["end"]) for id_, now in panels().items()),
        "every chart has moved",
    )
    wait_until(
        lambda: all(any(map(str.isdigit, now["value"])) for now in panels().values()),
        "every channel says its interval",
    )
    assert all(now["coverage"].startswith("coverage ") for now in panels().values())


@pytest.mark.nightly
@pytest.mark.parametrize("options", [PHONE])
@pytest.mark.parametrize("place", ["", "palm/t01.energy?live=10s&above=5e-12"])
def test_phone_width_overflows_nowhere(visit: Visit, place: str) -> None:
    visit.open(place)
    # In the overview, charts are out of sight below the picture of a skin.
    shown = f"{CHART}[data-mode=live]" if place else "[data-testid=skin-view][data-newest]"
    visit.page.locator(shown).first.wait_for()
    visit.wait_for_answers()
    page, window = visit.evaluate("() => [document.documentElement.scrollWidth, innerWidth]")
    assert window == 390
    assert page <= window


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{"viewport": {"width": 1280, "height": 800}}, PHONE])
def test_cards_of_six_nodes_are_shown_whole(visit: Visit) -> None:
    def double(route: Route) -> None:
        answer = route.fetch()
        items = answer.json()["items"]
        twins = [{**item, "id": f"{item['id']}-2"} for item in items]
        route.fulfill(response=answer, json={"items": [*items, *twins], "next": None})

    visit.page.route("**/api/v1/nodes", double)
    visit.open("palm/t01.energy?live=10s")
    visit.page.locator("[data-testid=node]").nth(2 * len(NODES) - 1).wait_for()
    cut = visit.evaluate("""() => {
      const nodes = document.querySelector("[data-testid=nodes]");
      // Where there is room, their box is also that of gateways and store.
      const box = nodes.getClientRects().length ? nodes : nodes.parentElement;
      const strip = box.getBoundingClientRect();
      return [...document.querySelectorAll("[data-testid=node]")].filter((card) => {
        const { left, right, top, bottom } = card.getBoundingClientRect();
        const facts = [...card.querySelectorAll("dd")];
        const tight = facts.some((fact) => fact.scrollWidth > fact.clientWidth);
        return tight || left < 0 || right > innerWidth || top < strip.top || bottom > strip.bottom;
      }).map((card) => card.dataset.node);
    }""")
    assert cut == []


@pytest.mark.parametrize("options", [{"color_scheme": "light"}])
def test_light_and_dark_differ(visit: Visit) -> None:
    def colours() -> list[str]:
        found: list[str] = visit.evaluate("""() => {
          const root = getComputedStyle(document.documentElement);
          const names = ["--chart-plot", "--chart-band-edge", "--chart-certain"];
          const paint = names.map((name) => root.getPropertyValue(name).trim());
          return [getComputedStyle(document.body).backgroundColor, ...paint];
        }""")
        return found

    visit.open("")
    light = colours()
    visit.page.get_by_test_id("theme").click()
    dark = colours()
    assert all(one != other for one, other in zip(light, dark, strict=True))
