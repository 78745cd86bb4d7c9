import type { EnergyJson, FaultJson, NodeItem } from "../api/contract";
import { printRoute } from "../state/route";
import { formatDuration, formatLag } from "../time/duration";
import type { Context } from "./context";
import { element } from "./element";
import { fact, fillMeter, formatBytes, hasRoom, seenAgo } from "./fact";
import { healthSymbol } from "./symbol";

function outboxMeter({ outbox }: NodeItem): HTMLElement {
  return outbox === null ? element("span", { class: "fact" }, "unknown") : fillMeter("outbox fill", outbox);
}

function outboxBytes({ outbox }: NodeItem): string | null {
  return outbox && `outbox ${formatBytes(outbox.bytes)} of ${formatBytes(outbox.capacity_bytes)}`;
}

const MINUTE_NS = 60e9;
const SUSTAINS = { certain: "sustains itself", possible: "may sustain itself", impossible: "discharges" };

/** State of charge as bounds, rounded outward, and whether the node sustains itself. */
export function batteryText({ charge, self_sustaining, shedding }: EnergyJson): string {
  const low = Math.floor((charge.lo ?? 0) * 100);
  const high = Math.ceil((charge.hi ?? 1) * 100);
  const shed = shedding === "none" ? "" : ` · sheds to ${shedding}`;
  return `${low}–${high} % · ${SUSTAINS[self_sustaining]}${shed}`;
}

function battery({ energy }: NodeItem): HTMLElement[] {
  if (energy === null) return [];
  const warn = energy.self_sustaining === "impossible" || energy.shedding !== "none";
  const text = element("span", { class: warn ? "sentence warn" : "sentence", "data-testid": "node-energy" }, batteryText(energy));
  return fact("battery", text);
}

/** Which taxels are certainly broken, by name; and how many may be. */
export function faultsText(faults: readonly FaultJson[]): string {
  const certain = faults.filter(({ dead, stuck }) => dead === "certain" || stuck === "certain");
  const named = certain.map(({ taxel, dead }) => `${taxel} ${dead === "certain" ? "dead" : "stuck"}`);
  const rest = faults.length - certain.length;
  if (rest > 0) named.push(`${rest} possibly`);
  return named.join(", ") || "none";
}

function broken({ faults }: NodeItem): HTMLElement[] {
  if (faults === null) return [];
  const warn = faults.some(({ dead, stuck }) => dead === "certain" || stuck === "certain");
  const possible = faults.map(({ taxel, dead, stuck }) => `${taxel}: dead ${dead}, stuck ${stuck}`).join("\n");
  return fact(
    "broken",
    element("span", { class: warn ? "sentence warn" : "sentence", title: possible, "data-testid": "node-faults" }, faultsText(faults)),
    faults.length === 0,
  );
}

/** Of a node that seals all it sends, times are known to the minute alone. */
function lagOf({ lag }: NodeItem): HTMLElement {
  const sealed = lag !== null && lag.hi_ns - lag.lo_ns >= MINUTE_NS;
  const title = sealed ? "Its frames are sealed: their times are known only to the minute" : null;
  return element("span", { "data-testid": "node-lag", title }, sealed ? `${formatLag(lag)}, sealed` : formatLag(lag));
}

/** Shown only where messages prove that the node's clock is beyond its stated bound. */
function wrongClock({ clock }: NodeItem): HTMLElement[] {
  if (clock === null || clock.verdict !== "impossible") return [];
  const { lo_ns: least, hi_ns: most } = clock.offset;
  const ahead = least !== null && least > 0;
  const size = ahead ? least : -(most ?? 0);
  const text = `≥ ${formatDuration(size, "down")} ${ahead ? "ahead" : "behind"}`;
  const title = "This node's clock is wrong by more than its stated bound";
  return fact("clock", element("span", { class: "sentence warn", title, "data-testid": "node-clock" }, text));
}

/** Shown only where messages of the node are lost without a word of it. */
function missingOf({ missing }: NodeItem): HTMLElement[] {
  if (missing === null) return [];
  const text = `${missing.messages.toLocaleString("en")} ${missing.messages === 1 ? "message" : "messages"}`;
  const title = `Acknowledged to the node but not stored; first noticed ${missing.since}`;
  return fact("missing", element("span", { class: "sentence warn", title, "data-testid": "node-missing" }, text));
}

function uptime({ uptime_ns }: NodeItem): string {
  return uptime_ns === null ? "–" : `up ${formatDuration(Math.floor(uptime_ns / 1e9) * 1e9)}`;
}

/** A node at a glance: health by shape and text, last seen, outbox and gaps. */
export function nodeCard(
  node: NodeItem,
  options: { href: string; current: boolean; now: bigint; reachable: boolean },
): HTMLElement {
  const health = options.reachable ? node.health : "unknown";
  const head = element(
    "div",
    { class: "card-head" },
    healthSymbol(health),
    element("strong", {}, node.id),
    element("span", { class: `badge ${health}`, "data-testid": "node-health" }, health),
  );
  const gaps = element("span", { class: node.gaps > 0 ? "warn" : "", "data-testid": "node-gaps" }, node.gaps.toLocaleString("en"));
  const facts = element(
    "dl",
    { class: "facts" },
    ...fact("seen", seenAgo(node.last_seen, options.now), true),
    ...fact("lag", lagOf(node)),
    ...fact("outbox", outboxMeter(node), node.outbox !== null && hasRoom(node.outbox)),
    ...fact("gaps", gaps, node.gaps === 0),
    ...battery(node),
    ...broken(node),
    ...wrongClock(node),
    ...missingOf(node),
    ...fact("boot", element("span", { class: "sentence" }, `${node.boot} · ${uptime(node)}`), true),
  );
  return element(
    "a",
    {
      class: "card",
      href: options.href,
      "aria-current": options.current ? "page" : null,
      "data-testid": "node",
      "data-node": node.id,
      "data-health": health,
      title: [node.description, `last seen ${node.last_seen}`, outboxBytes(node)].filter(Boolean).join("\n"),
    },
    head,
    facts,
  );
}

/** The overview of all nodes, above every view. */
export class NodeStrip {
  readonly root = element("nav", { class: "nodes", "aria-label": "nodes", "data-testid": "nodes" });
  private drawn = "";
  private linked = "";

  constructor(private readonly context: Context) {}

  /**
   * Draws the cards anew when anything has changed; the focus stays on its card. Where only the window has, as with
   * every step of a gesture, it is enough that they lead to it.
   *
   * @param reachable whether the cloud answers: if not, their health is unknown
   */
  show(nodes: readonly NodeItem[], now: bigint, reachable: boolean): void {
    const route = this.context.route();
    const state = JSON.stringify([nodes, reachable, route.node, Number(now / 1_000_000_000n)]);
    const links = printRoute({ ...route, node: null });
    const same = state === this.drawn;
    if (same && links === this.linked) return;
    [this.drawn, this.linked] = [state, links];
    if (same) {
      for (const [index, node] of nodes.entries()) this.root.children[index]?.setAttribute("href", this.href(node.id));
      return;
    }
    const cards = nodes.map((node) => nodeCard(node, { href: this.href(node.id), current: route.node === node.id, now, reachable }));
    const held = new Map([...this.root.children].map((card) => [card.getAttribute("data-node"), card]));
    for (const [index, card] of cards.entries()) {
      const shown = this.adopt(held.get(card.getAttribute("data-node")) ?? null, card);
      if (this.root.children[index] !== shown) this.root.insertBefore(shown, this.root.children[index] ?? null);
    }
    while (this.root.children.length > cards.length) this.root.lastElementChild?.remove();
  }

  /** Where a card leads: to its node, and from that back to all of them. */
  private href(node: string): string {
    const route = this.context.route();
    const back = route.node === node && route.channel === null;
    return printRoute({ ...route, node: back ? null : node, channel: null, question: null });
  }

  /** Fills a card that is on the page already, so that a click or the focus on it is not lost. */
  private adopt(held: Element | null, card: Element): Element {
    if (held === null) return card;
    for (const name of held.getAttributeNames()) if (!card.hasAttribute(name)) held.removeAttribute(name);
    for (const { name, value } of card.attributes) held.setAttribute(name, value);
    held.replaceChildren(...card.childNodes);
    return held;
  }
}
