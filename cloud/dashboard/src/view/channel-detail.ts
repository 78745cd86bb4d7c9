import type { ChannelItem } from "../api/contract";
import { formatCoverage, formatInterval } from "../interval/format";
import { readInterval } from "../interval/interval";
import { printRoute } from "../state/route";
import { formatDuration } from "../time/duration";
import { parseInstant, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { element } from "./element";
import { formatBytes } from "./fact";

function formatTime(text: string | null): string {
  if (text === null) return "–";
  const instant = parseInstant(text);
  return `${printDay(instant)} ${printClock(instant, 0)}`;
}

/** The way back from a channel to its node and to all nodes. */
export function crumbs(context: Context, node: string, channel: string): HTMLElement {
  const route = { ...context.route(), channel: null, question: null };
  return element(
    "nav",
    { class: "crumbs", "aria-label": "path" },
    element("a", { href: printRoute({ ...route, node: null }) }, "All nodes"),
    element("a", { href: printRoute({ ...route, node }) }, node),
    element("span", { "aria-current": "page" }, channel),
  );
}

/** The size of a channel's blocks in the store, whole and per sample, rounded up. */
export function storedText({ bytes, samples }: Pick<ChannelItem, "bytes" | "samples">): string {
  if (bytes === null) return "sealed";
  if (samples === null || samples === 0) return formatBytes(bytes);
  return `${formatBytes(bytes)} · ${(Math.ceil((bytes / samples) * 100) / 100).toFixed(2)} B per sample`;
}

/** What the store knows of a channel. */
export function channelFacts(channel: ChannelItem): HTMLElement {
  const facts: readonly (readonly [string, string])[] = [
    ["sampled every", formatDuration(channel.dt)],
    ["samples", channel.samples?.toLocaleString("en") ?? "–"],
    ["blocks", channel.blocks?.toLocaleString("en") ?? "–"],
    ["in the store", storedText(channel)],
    ["bounds", channel.bounds ? formatInterval(readInterval(channel.bounds), channel.unit) : "–"],
    ["coverage", formatCoverage(channel.coverage)],
    ["first", formatTime(channel.first)],
    ["last", formatTime(channel.last)],
  ];
  const list = element("dl", { class: "channel-facts", "data-testid": "channel-facts" });
  for (const [name, value] of facts) list.append(element("div", {}, element("dt", {}, name), element("dd", {}, value)));
  return list;
}
