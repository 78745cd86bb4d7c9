import type { ChannelItem } from "../api/contract";
import { formatCoverage } from "../interval/format";
import { printPlace } from "../state/place";
import type { Context } from "./context";
import { element, icon } from "./element";
import { ICONS } from "./symbol";

export interface PanelHeadOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: ChannelItem;
  readonly alone: boolean;
  /** Where the panel writes its interval. */
  readonly value: HTMLElement;
}

function channelLink(options: PanelHeadOptions, name: readonly HTMLElement[]): HTMLElement {
  const { context, node, channel } = options;
  const href = (): string => printPlace({ ...context.place(), node, channel: channel.id, question: null });
  const link = element("a", { href: href(), "data-testid": "channel-link" }, ...name, icon(ICONS.open));
  for (const type of ["pointerenter", "focus", "click"]) {
    // The window may have changed since the link was written.
    link.addEventListener(type, () => link.setAttribute("href", href()));
  }
  return element("h3", {}, link);
}

/** A panel's title, present interval and coverage. */
export function panelHead(options: PanelHeadOptions): HTMLElement {
  const { channel, alone, value } = options;
  const name = [
    element("span", { class: "taxel" }, channel.taxel),
    element("span", {}, channel.quantity.replaceAll("_", " ")),
  ];
  const title = alone ? element("h2", {}, ...name) : channelLink(options, name);
  const meaning = "How often the interval encloses the truth, for each sample";
  const coverage = element("span", { class: "coverage", title: meaning }, `coverage ${formatCoverage(channel.coverage)}`);
  return element("header", { class: "panel-head" }, title, value, coverage);
}

/** What a panel's chart stands in, and is worked through by keys. */
export function chartRoot(node: string, channel: string): HTMLElement {
  const keys = "Arrows pan, plus and minus zoom, comma and full stop read values, L goes live.";
  const label = `Chart of ${node} ${channel}. ${keys}`;
  const place = { "data-testid": "chart", "data-node": node, "data-channel": channel };
  return element("div", { class: "chart", tabindex: 0, role: "group", "aria-label": label, ...place });
}
