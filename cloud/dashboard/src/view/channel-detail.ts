import type { ChannelItem } from "../api/contract";
import { formatCoverage } from "../interval/format";
import { printRoute } from "../state/route";
import { formatDuration } from "../time/duration";
import { parseInstant, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { element } from "./element";

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

/** What the store knows of a channel. Of a biometric one, times are known to the minute. */
export function channelFacts(channel: ChannelItem): HTMLElement {
  const [since, until] = channel.biometric ? ["not before ", "before "] : ["", ""];
  const facts: readonly (readonly [string, string])[] = [
    ["sampled every", channel.dt === null ? "unknown" : formatDuration(channel.dt)],
    ["coverage", formatCoverage(channel.coverage)],
    ["first", channel.first === null ? formatTime(null) : `${since}${formatTime(channel.first)}`],
    ["last", channel.last === null ? formatTime(null) : `${until}${formatTime(channel.last)}`],
  ];
  const list = element("dl", { class: "channel-facts", "data-testid": "channel-facts" });
  for (const [name, value] of facts) list.append(element("div", {}, element("dt", {}, name), element("dd", {}, value)));
  return list;
}
