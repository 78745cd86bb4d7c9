import type { EventItem } from "../api/contract";
import { formatCount, formatInterval } from "../interval/format";
import { readInterval } from "../interval/interval";
import { formatDuration } from "../time/duration";
import { parseInstant, printClock, printDay } from "../time/instant";
import { element, icon } from "./element";
import { ICONS, verdictSymbol } from "./symbol";

/** What a list of events is limited to. */
export interface EventScope {
  readonly node: string | null;
  readonly channel: string | null;
}

/** A gap that tells of a broken taxel; what it spans is when that was found. */
const FAULT = / certainly (stuck|dead)/;

function symbol(event: EventItem): SVGSVGElement {
  if (event.kind === "peak" && event.verdict) return verdictSymbol(event.verdict);
  const made = icon(event.kind === "gap" ? ICONS.gap : event.kind === "command" ? ICONS.command : ICONS.status);
  made.classList.add("kind", event.kind);
  return made;
}

function what(event: EventItem): string {
  if (event.kind === "gap") {
    if (event.detail && FAULT.test(event.detail)) return event.detail;
    const length = Number(parseInstant(event.time.hi) - parseInstant(event.time.lo));
    return [`gap of ${formatDuration(length, "up")}`, event.detail].filter(Boolean).join(": ");
  }
  if (event.kind !== "peak") return event.detail ?? event.kind;
  const height = event.height ? formatInterval(readInterval(event.height), event.unit ?? "") : "";
  const count = event.count ? formatCount(readInterval(event.count)) : "1";
  return `${height}${count === "1" ? "" : ` × ${count}`}`;
}

function when(event: EventItem, now: bigint): string {
  const begin = parseInstant(event.time.lo);
  const distance = now > begin ? now - begin : begin - now;
  const far = distance > 43_200_000_000_000n;
  return `${far ? `${printDay(begin)} ` : ""}${printClock(begin, far ? 0 : 3)}`;
}

/** Where an event was, without what the list's scope says already. */
function where(event: EventItem, scope: EventScope): string {
  const channel = scope.channel === null ? event.channel : null;
  return [scope.node === null ? event.node : null, channel].filter((part) => part !== null).join(" · ");
}

/** One event: its symbol, what it says, where and when. The row opens the place of the event. */
export function eventRow(event: EventItem, scope: EventScope, now: bigint, href: string): HTMLElement {
  const kind = event.verdict ? `${event.verdict} ${event.kind}` : event.kind;
  const place = where(event, scope);
  const link = element(
    "a",
    { href, class: "event", title: `${kind}\n${event.time.lo} to ${event.time.hi}` },
    symbol(event),
    element("span", { class: "event-kind" }, kind),
    element("time", { datetime: event.time.lo }, when(event, now)),
    element("span", { class: "event-what" }, what(event)),
    element("span", { class: "event-place", title: place }, place),
  );
  const attributes = {
    "data-testid": "event",
    "data-id": event.id,
    "data-kind": event.kind,
    "data-verdict": event.verdict,
    "data-node": event.node,
    "data-channel": event.channel,
  };
  return element("li", attributes, link);
}
