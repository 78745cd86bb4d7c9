import type { EventQuery } from "../api/client";
import type { EventItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { formatCount, formatInterval } from "../interval/format";
import { readInterval } from "../interval/interval";
import { printRoute, type View } from "../state/route";
import { formatDuration } from "../time/duration";
import { type Instant, parseInstant, printClock, printDay } from "../time/instant";
import { Throttle } from "../time/throttle";
import type { Context } from "./context";
import { button, element, icon, setText } from "./element";
import { NoticeBoard } from "./notice";
import { ICONS, verdictSymbol } from "./symbol";

/** What a list of events is limited to. */
export interface EventScope {
  readonly node: string | null;
  readonly channel: string | null;
}

/** A gap that reports a broken taxel; it spans the self-test that found it. */
const FAULT = / certainly (stuck|dead)/;

function symbol(event: EventItem): SVGSVGElement {
  const { kind, verdict } = event;
  if ((kind === "peak" || kind === "verdict") && verdict && verdict !== "impossible") return verdictSymbol(verdict);
  const made = icon(event.kind === "gap" ? ICONS.gap : event.kind === "command" ? ICONS.command : ICONS.status);
  made.classList.add("kind", event.kind);
  return made;
}

/** A monitor's verdict: its name, and why it is only possible. */
function monitorText(detail: string): string {
  const found: unknown = JSON.parse(detail);
  if (typeof found !== "object" || found === null || !("monitor" in found)) return detail;
  const because = "because" in found && Array.isArray(found.because) ? found.because.join(", ") : "";
  return because === "" ? String(found.monitor) : `${String(found.monitor)}: by ${because}`;
}

/** What an event's row says of it. */
export function what(event: EventItem): string {
  if (event.kind === "verdict" && event.detail) return monitorText(event.detail);
  if (event.kind === "gap") {
    if (event.detail && FAULT.test(event.detail)) return event.detail;
    const length = Number(parseInstant(event.time.hi) - parseInstant(event.time.lo));
    return [formatDuration(length, "up"), event.detail].filter(Boolean).join(": ");
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

/** Where an event was, without what the list's scope implies. */
function where(event: EventItem, scope: EventScope): string {
  const channel = scope.channel === null ? event.channel : null;
  return [scope.node === null ? event.node : null, channel].filter((part) => part !== null).join(" · ");
}

/** One event: symbol, content, channel and time. The row opens the event's window. */
export function eventRow(event: EventItem, scope: EventScope, now: bigint, href: string): HTMLElement {
  const kind = event.verdict ? `${event.verdict} ${event.kind}` : event.kind;
  const location = where(event, scope);
  const link = element(
    "a",
    { href, class: location === "" ? "event placeless" : "event", title: `${kind}\n${event.time.lo} to ${event.time.hi}` },
    symbol(event),
    element("span", { class: "event-kind" }, kind),
    element("time", { datetime: event.time.lo }, when(event, now)),
    element("span", { class: "event-what" }, what(event)),
    element("span", { class: "event-place", title: location }, location),
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

interface Filter {
  kind: string;
  verdict: string;
}

const PAGE = 50;
const MOST_ROWS = 100;
/** How much time to show around an event that is opened, at least (ns). */
const AROUND = 2_000_000_000n;
const RETRY_MS = 5_000;
/** New events move all rows: as often as can be read is enough. */
const WRITE_MS = 1_000;

/** The window whose events are listed; none while it is live: then the latest are. */
function windowOf(view: View): { start?: Instant; end?: Instant } {
  return view.kind === "history" ? { start: view.from, end: view.to } : {};
}

/** The events of the view's scope and window, newest first, with filters. */
export class EventList {
  readonly root: HTMLElement;
  private readonly rows = element("ol", { class: "events", "data-testid": "events" });
  private readonly note = element("p", { class: "events-note", role: "status", "data-testid": "events-note" });
  private readonly foot = element("div", { class: "events-foot" });
  private readonly notices = new NoticeBoard(this.foot);
  private readonly filter: Filter = { kind: "", verdict: "" };
  private readonly known = new Set<string>();
  private waiting: EventItem[] = [];
  private readonly beat = new Throttle(WRITE_MS);
  private cursor: string | null = null;
  private loading = new AbortController();
  /** Whether the rows are to be replaced: then what comes in waits, or it would be replaced, too. */
  private outdated = true;
  /** What was asked for last. */
  private window = windowOf({ kind: "live", span: 0 });
  private retry: ReturnType<typeof setTimeout> | null = null;

  constructor(
    private readonly context: Context,
    private readonly scope: EventScope,
  ) {
    const kinds = this.choice("kind", "all kinds", ["peak", "verdict", "gap", "status", "command"]);
    const verdicts = this.choice("verdict", "all verdicts", ["certain", "possible", "impossible"]);
    const filters = element("div", { class: "filters" }, kinds, verdicts);
    const head = element("header", { class: "side-head" }, element("h2", {}, "Events"), filters);
    this.root = element("aside", { class: "side", "aria-label": "events" }, head, this.note, this.rows, this.foot);
    this.notices.show("loading", "Loading events…", "");
  }

  /** Asks for the events of the window that is shown. */
  async load(): Promise<void> {
    this.notices.show("loading", "Loading events…", "");
    await this.refresh();
  }

  /** Asks for events, without a word before the answer. */
  async refresh(): Promise<void> {
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = null;
    this.loading.abort();
    this.loading = new AbortController();
    this.known.clear();
    this.waiting = [];
    this.cursor = null;
    this.outdated = true;
    this.window = windowOf(this.context.route().view);
    await this.more();
  }

  /** Asks for other events, if another window is shown. */
  async follow(): Promise<void> {
    const { start, end } = windowOf(this.context.route().view);
    if (start === this.window.start && end === this.window.end) return;
    this.rows.setAttribute("aria-busy", "true");
    await this.load();
  }

  /** Says that there is no such node, of which there can be no events. */
  showAbsence(node: string): void {
    this.notices.show("empty", `There is no node "${node}"`, "Choose one of the nodes above for its events.");
  }

  /** Puts those of the latest events on top that the live stream did not bring. */
  async catchUp(): Promise<void> {
    if (this.outdated) return;
    const { signal } = this.loading;
    try {
      const { items } = await this.context.client.events({ ...this.query(), limit: PAGE }, signal);
      for (const event of items.toReversed()) this.take(event);
    } catch (error) {
      if (!isAbort(error)) this.fail(error);
    }
  }

  /** Says what the charts leave out. */
  remark(text: string): void {
    setText(this.note, text);
  }

  /** Puts a live event on top, if it passes the filters. */
  take(event: EventItem): void {
    if (this.passes(event)) this.waiting.push(event);
    if (this.waiting.length > MOST_ROWS) this.waiting.shift();
  }

  /** Writes what has come in. */
  frame(at: number): void {
    if (this.outdated || !this.beat.due(at) || this.waiting.length === 0) return;
    const fresh = this.waiting.filter((event) => !this.known.has(event.id));
    this.waiting = [];
    for (const event of fresh) this.rows.prepend(this.row(event));
    this.trim();
  }

  /** Says that events could not be loaded, and offers to try again. */
  fail(error: unknown): void {
    const again = { label: "Try again", act: () => void this.load() };
    this.notices.show("error", "Events could not be loaded", messageOf(error), again);
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = setTimeout(() => void this.refresh(), RETRY_MS);
  }

  destroy(): void {
    if (this.retry !== null) clearTimeout(this.retry);
    this.loading.abort();
    this.root.remove();
  }

  private choice(name: keyof Filter, all: string, values: readonly string[]): HTMLSelectElement {
    const attributes = { "aria-label": `filter by ${name}`, "data-testid": `filter-${name}` };
    const select = element("select", attributes, element("option", { value: "" }, all));
    for (const value of values) select.append(element("option", { value }, value));
    select.addEventListener("change", () => {
      this.filter[name] = select.value;
      void this.load();
    });
    return select;
  }

  private passes(event: EventItem): boolean {
    const { kind, verdict } = this.filter;
    const { node, channel } = this.scope;
    const { start, end } = this.window;
    if (start !== undefined && parseInstant(event.time.hi) < start) return false;
    if (end !== undefined && parseInstant(event.time.lo) >= end) return false;
    if (node !== null && event.node !== node) return false;
    if (channel !== null && event.channel !== null && event.channel !== channel) return false;
    return (kind === "" || event.kind === kind) && (verdict === "" || event.verdict === verdict);
  }

  private row(event: EventItem): HTMLElement {
    this.known.add(event.id);
    return eventRow(event, this.scope, BigInt(Date.now()) * 1_000_000n, this.target(event));
  }

  private target(event: EventItem): string {
    const from = parseInstant(event.time.lo);
    const to = parseInstant(event.time.hi);
    const room = to - from > AROUND ? to - from : AROUND;
    const view = { kind: "history", from: from - room / 2n, to: to + room / 2n } as const;
    return printRoute({ node: event.node, channel: event.channel ?? this.scope.channel, view, question: null });
  }

  private query(): EventQuery {
    return { node: this.scope.node ?? undefined, channel: this.scope.channel ?? undefined, ...this.filter, ...this.window };
  }

  private trim(): void {
    while (this.rows.children.length > MOST_ROWS) {
      const last = this.rows.lastElementChild;
      this.known.delete(last?.getAttribute("data-id") ?? "");
      last?.remove();
      this.cursor = null;
    }
    if (this.rows.children.length > 0 && this.notices.kind === "empty") this.notices.clear();
  }

  private async more(): Promise<void> {
    const { signal } = this.loading;
    const first = this.cursor === null;
    const query = { ...this.query(), limit: PAGE, cursor: this.cursor ?? undefined };
    try {
      const page = await this.context.client.events(query, signal);
      const fresh = page.items.filter((event) => first || !this.known.has(event.id));
      const rows = fresh.map((event) => this.row(event));
      if (first) this.replace(rows);
      else this.rows.append(...rows);
      this.cursor = page.next;
      this.showFoot();
    } catch (error) {
      if (isAbort(error)) return;
      this.fail(error);
    }
    this.outdated = false;
  }

  /** An event that has opened its own window keeps the focus. */
  private replace(rows: readonly HTMLElement[]): void {
    const focused = this.rows.contains(document.activeElement) ? document.activeElement?.parentElement?.dataset["id"] : undefined;
    this.rows.replaceChildren(...rows);
    this.rows.removeAttribute("aria-busy");
    if (focused !== undefined) rows.find((row) => row.dataset["id"] === focused)?.querySelector("a")?.focus({ preventScroll: true });
  }

  private showFoot(): void {
    if (this.rows.children.length === 0) {
      const filtered = this.filter.kind !== "" || this.filter.verdict !== "";
      const nothing = this.window.start === undefined ? "No events yet" : "No events in this window";
      this.notices.show("empty", filtered ? "No event passes the filters" : nothing, "");
      return;
    }
    this.notices.clear();
    const older = this.cursor !== null && this.rows.children.length < MOST_ROWS;
    this.foot.replaceChildren(...(older ? [button("Older events", { class: "plain" }, () => void this.more())] : []));
  }
}
