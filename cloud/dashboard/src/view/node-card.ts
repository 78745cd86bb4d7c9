import type { EnergyJson, FaultJson, NodeItem } from "../api/contract";
import { formatDuration } from "../time/duration";
import { parseInstant, printClock, printDay } from "../time/instant";
import { element } from "./element";
import { healthSymbol } from "./symbol";


/** Prints bytes with a binary prefix, rounded up. */
export function formatBytes(bytes: number): string {
  const names = ["B", "KiB", "MiB", "GiB", "TiB"];
  let scale = 0;
  while (scale < names.length - 1 && bytes >= 1024 ** (scale + 1)) scale += 1;
  const value = bytes / 1024 ** scale;
  const text = scale === 0 || value >= 100 ? Math.ceil(value) : Math.ceil(value * 10) / 10;
  return `${text} ${names[scale]}`;
}

function lastSeen(node: NodeItem, now: bigint): { text: string; title: string } {
  if (node.last_seen === null) return { text: "never", title: "This node has not reported yet." };
  const seen = parseInstant(node.last_seen);
  const ago = Number(now - seen);
  const clock = now - seen > 86_400_000_000_000n ? `${printDay(seen)} ${printClock(seen, 0)}` : printClock(seen, 0);
  const text = ago < 2e9 ? `${clock}, now` : `${clock}, ${formatDuration(Math.floor(ago / 1e9) * 1e9)} ago`;
  return { text, title: node.last_seen };
}

function outboxMeter(node: NodeItem): HTMLElement {
  const { outbox } = node;
  if (outbox === null) return element("span", { class: "fact" }, "unknown");
  const share = outbox.capacity_bytes > 0 ? Math.min(1, outbox.bytes / outbox.capacity_bytes) : 0;
  const percent = Math.ceil(share * 100);
  const bar = element("span", { class: "meter-fill" });
  bar.style.width = `${percent}%`;
  const level = percent >= 80 ? "high" : percent >= 40 ? "middle" : "low";
  const text = `${percent} % · ${outbox.messages} msg`;
  return element(
    "span",
    { class: "meter-line" },
    element("span", { class: "meter", "data-level": level, role: "meter", "aria-label": "outbox fill", "aria-valuenow": percent, "aria-valuemin": 0, "aria-valuemax": 100 }, bar),
    element("span", {}, text),
  );
}

function outboxBytes({ outbox }: NodeItem): string | null {
  return outbox && `outbox ${formatBytes(outbox.bytes)} of ${formatBytes(outbox.capacity_bytes)}`;
}

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
  const text = element("span", { class: warn ? "warn" : "", "data-testid": "node-energy" }, batteryText(energy));
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
    element("span", { class: warn ? "warn" : "", title: possible, "data-testid": "node-faults" }, faultsText(faults)),
  );
}

function fact(name: string, value: HTMLElement | string): HTMLElement[] {
  return [element("dt", {}, name), element("dd", {}, value)];
}

/** A node at a glance: health by shape and text, last seen, outbox and gaps. */
export function nodeCard(
  node: NodeItem,
  options: { href: string; current: boolean; now: bigint; reachable: boolean },
): HTMLElement {
  const seen = lastSeen(node, options.now);
  const health = options.reachable ? node.health : "unknown";
  const head = element(
    "div",
    { class: "card-head" },
    healthSymbol(health),
    element("strong", {}, node.id),
    element("span", { class: `badge ${health}`, "data-testid": "node-health" }, health),
  );
  const gaps = element("span", { class: node.gaps > 0 ? "warn" : "" }, String(node.gaps));
  const facts = element(
    "dl",
    { class: "facts" },
    ...fact("seen", seen.text),
    ...fact("outbox", outboxMeter(node)),
    ...fact("gaps", gaps),
    ...battery(node),
    ...broken(node),
    ...fact("boot", `${node.boot ?? "–"} · ${node.uptime_ns === null ? "–" : `up ${formatDuration(Math.floor(node.uptime_ns / 1e9) * 1e9)}`}`),
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
      title: [node.description, `last seen ${seen.title}`, outboxBytes(node)].filter(Boolean).join("\n"),
    },
    head,
    facts,
  );
}
