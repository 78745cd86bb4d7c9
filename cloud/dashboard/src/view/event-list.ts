import type { EventItem } from "../api/contract";
import { isAbort, messageOf } from "../api/failure";
import { printPlace } from "../state/place";
import { Beat, TEXT_MS } from "../time/beat";
import { parseInstant } from "../time/instant";
import type { Context } from "./context";
import { button, element, setText } from "./element";
import { eventRow, type EventScope } from "./event-row";
import { NoticeBoard } from "./notice";

interface Filter {
  kind: string;
  verdict: string;
}

const PAGE = 50;
const MOST_ROWS = 300;
/** How much time to show around an event that is opened, at least (ns). */
const AROUND = 2_000_000_000n;
const RETRY_MS = 5_000;

/** The latest events of the view's scope, newest first, with filters. */
export class EventList {
  readonly root: HTMLElement;
  private readonly rows = element("ol", { class: "events", "data-testid": "events" });
  private readonly note = element("p", { class: "events-note", role: "status", "data-testid": "events-note" });
  private readonly foot = element("div", { class: "events-foot" });
  private readonly notices = new NoticeBoard(this.foot);
  private readonly filter: Filter = { kind: "", verdict: "" };
  private readonly known = new Set<string>();
  private waiting: EventItem[] = [];
  private readonly beat = new Beat(TEXT_MS);
  private cursor: string | null = null;
  private loading = new AbortController();
  private retry: ReturnType<typeof setTimeout> | null = null;

  constructor(
    private readonly context: Context,
    private readonly scope: EventScope,
  ) {
    const kinds = this.choice("kind", "all kinds", ["peak", "gap", "status", "command"]);
    const verdicts = this.choice("verdict", "all verdicts", ["certain", "possible"]);
    const filters = element("div", { class: "filters" }, kinds, verdicts);
    const head = element("header", { class: "side-head" }, element("h2", {}, "Events"), filters);
    this.root = element("aside", { class: "side", "aria-label": "events" }, head, this.note, this.rows, this.foot);
    void this.load();
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

  /** Writes what has come in; a few times a second is enough. */
  frame(at: number): void {
    if (!this.beat.due(at) || this.waiting.length === 0) return;
    const fresh = this.waiting.filter((event) => !this.known.has(event.id));
    this.waiting = [];
    for (const event of fresh) this.rows.prepend(this.row(event));
    this.trim();
  }

  /** Says that events could not be loaded, and offers to try again. */
  fail(error: unknown): void {
    const again = { label: "Try again", act: () => void this.load() };
    this.notices.say("error", "Events could not be loaded", messageOf(error), again);
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = setTimeout(() => void this.reload(), RETRY_MS);
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
    return printPlace({ node: event.node, channel: event.channel ?? this.scope.channel, view, question: null });
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

  private async load(): Promise<void> {
    this.notices.say("loading", "Loading events…", "");
    await this.reload();
  }

  /** Asks for the latest events, without a word before the answer. */
  private async reload(): Promise<void> {
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = null;
    this.loading.abort();
    this.loading = new AbortController();
    this.known.clear();
    this.waiting = [];
    this.cursor = null;
    await this.more();
  }

  private async more(): Promise<void> {
    const { signal } = this.loading;
    const first = this.cursor === null;
    const scope = { node: this.scope.node ?? undefined, channel: this.scope.channel ?? undefined };
    const query = { ...scope, ...this.filter, limit: PAGE, cursor: this.cursor ?? undefined };
    try {
      const page = await this.context.client.events(query, signal);
      const told = first ? this.toldMeanwhile(page.items) : [];
      const fresh = page.items.filter((event) => first || !this.known.has(event.id));
      const rows = fresh.map((event) => this.row(event));
      if (first) this.rows.replaceChildren(...told, ...rows);
      else this.rows.append(...rows);
      this.cursor = page.next;
      this.showFoot();
    } catch (error) {
      if (!isAbort(error)) this.fail(error);
    }
  }

  /** The rows of what the stream told since the store was asked, which had not stored it yet. */
  private toldMeanwhile(stored: readonly EventItem[]): Element[] {
    const listed = new Set<string | null>(stored.map(({ id }) => id));
    const isNew = (id: string | null): boolean => id !== null && this.known.has(id) && !listed.has(id);
    return [...this.rows.children].filter((row) => isNew(row.getAttribute("data-id")));
  }

  private showFoot(): void {
    if (this.rows.children.length === 0) {
      const filtered = this.filter.kind !== "" || this.filter.verdict !== "";
      this.notices.say("empty", filtered ? "No event passes the filters" : "No events yet", "");
      return;
    }
    this.notices.clear();
    const older = this.cursor !== null && this.rows.children.length < MOST_ROWS;
    this.foot.replaceChildren(...(older ? [button("Older events", { class: "plain" }, () => void this.more())] : []));
  }
}
