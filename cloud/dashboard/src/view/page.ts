import { address } from "../api/client";
import type { EventItem, NodeItem } from "../api/contract";
import { isAbort } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { type FeedState, FrameFeed, type LiveMessage } from "../live/frame-feed";
import type { Route } from "../state/route";
import type { Range } from "../state/window";
import { parseInstant, printClock, printDay } from "../time/instant";
import { Throttle, TEXT_MS } from "../time/throttle";
import { channelFacts, crumbs } from "./channel-detail";
import { ChannelQuestions } from "./channel-questions";
import { ChannelSection } from "./channel-section";
import type { Context } from "./context";
import { element } from "./element";
import { EventList } from "./event-list";
import { NodeSection } from "./node-section";
import { NodeSettings } from "./node-settings";
import { NoticeBoard } from "./notice";
import type { Section } from "./section";

export interface PageOptions {
  readonly context: Context;
  readonly onFeed: (state: FeedState) => void;
  readonly onUnreadable: () => void;
  /** A status event came in: the nodes' cards are out of date. */
  readonly onStatus: () => void;
}

/** A chart shows at most so many pages of the latest peaks and gaps in its window. */
const EVENT_PAGES = 4;
const KINDS = ["gap", "peak"] as const;
const SETTLE_MS = 250;
const SECOND = 1e9;
const DAY = 86_400e9;
/** The overview shows so many nodes, and no more channels; the strip of nodes leads to all others. */
const MOST_NODES = 12;
const MOST_CHANNELS = 40_000;
/** Events that the stream does not bring are asked for so often, in ms. */
const CATCH_UP_MS = 5_000;

/** The largest skin is what an overview begins with. */
function largestFirst(nodes: readonly NodeItem[]): NodeItem[] {
  return nodes.toSorted((a, b) => (b.channels ?? 0) - (a.channels ?? 0));
}

/** Everything below the nodes: the charts of one scope (all nodes, one node, one channel) and its events. */
export class Page {
  readonly root = element("main", { class: "page", tabindex: -1 });
  private readonly sections = new Map<string, Section>();
  /** The section that shows each node's frames. */
  private owners: ReadonlyMap<string, Section> = new Map();
  /** Nodes that another one's section shows, too: they share its skin. */
  private readonly shared = new Set<string>();
  private channels = 0;
  /** The nodes that the cloud lists. */
  private known: ReadonlySet<string> = new Set();
  /** Whether the overview leaves nodes out. */
  private partial = false;
  /** Whether the live stream left something out, events perhaps. */
  private missed = false;
  private readonly column = element("div", { class: "column" });
  private readonly notices = new NoticeBoard(this.column);
  private readonly list: EventList;
  private readonly scope: { readonly node: string | null; readonly channel: string | null };
  private questions: ChannelQuestions | null = null;
  private readonly settings: NodeSettings | null = null;
  private feed: FrameFeed | null = null;
  /** Whether events were loaded, and whether after the stream had opened. */
  private asked: "never" | "early" | "well" = "never";
  private eventLoading = new AbortController();
  /** Of which kinds there are too many events to mark, and since when they are marked. */
  private unmarked: { readonly kind: string; readonly since: number }[] = [];
  private readonly texts = new Throttle(TEXT_MS);
  private readonly catchUp = new Throttle(CATCH_UP_MS);
  private timer: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: PageOptions) {
    const { context } = options;
    const route = context.route();
    this.scope = { node: route.node, channel: route.channel };
    this.root.setAttribute("aria-label", [route.node ?? "All nodes", route.channel].filter(Boolean).join(" "));
    this.list = new EventList(context, this.scope);
    this.root.append(this.column, this.list.root);
    this.notices.show("loading", "Loading nodes…", "");
    if (route.node !== null && route.channel === null) {
      this.settings = new NodeSettings(context, route.node);
    }
    this.apply(route);
  }

  /** Takes over how the nodes are; the overview shows all of them, a page of one node keeps to it. */
  showNodes(nodes: readonly NodeItem[]): void {
    if (this.scope.node === null) this.showAll(nodes);
    else if (this.sections.size === 0) this.addFirst();
    for (const node of nodes) this.sections.get(node.id)?.showNode(node);
    this.known = new Set(nodes.map(({ id }) => id));
    for (const [id, section] of this.sections) if (!this.known.has(id)) section.showAbsence();
    if (this.scope.node !== null && !this.known.has(this.scope.node)) this.list.showAbsence(this.scope.node);
    this.connect();
  }

  /** Shows that the nodes could not be loaded; false where charts take the room. */
  showFailure(message: string, again: () => void): boolean {
    if (this.sections.size === 0 && this.scope.node !== null) this.addFirst();
    if (this.sections.size > 0) {
      for (const section of this.sections.values()) section.showFailure(message);
      return false;
    }
    const act = (): void => {
      this.notices.show("loading", "Loading nodes…", "");
      again();
    };
    this.notices.show("error", "The nodes could not be loaded", message, { label: "Try again", act });
    return true;
  }

  /** Takes over a change of the window or the question. */
  apply(route: Route): void {
    for (const section of this.sections.values()) section.apply(route.view);
    this.questions?.apply(route.question);
    this.wantEvents();
  }

  frame(at: number): void {
    for (const section of this.sections.values()) section.frame(at);
    this.list.frame(at);
    this.questions?.frame(at);
    this.settings?.frame(at);
    if (this.texts.due(at)) this.remark();
    if ((this.partial || this.missed) && this.catchUp.due(at)) {
      if (this.missed) this.wantEvents();
      this.missed = false;
      void this.list.catchUp();
    }
  }

  repaint(): void {
    for (const section of this.sections.values()) section.repaint();
  }

  /** The window shown now. */
  range(): Range | null {
    const { view } = this.options.context.route();
    const { timeline } = this.options.context;
    if (view.kind === "history") return { x0: timeline.toX(view.from), x1: timeline.toX(view.to) };
    for (const section of this.sections.values()) {
      const range = section.range();
      if (range) return range;
    }
    return null;
  }

  /** From the first to the last sample of everything on the page. */
  extent(): Range | null {
    const all = [...this.sections.values()].map((section) => section.extent()).filter((one) => one !== null);
    if (all.length === 0) return null;
    return { x0: Math.min(...all.map((one) => one.x0)), x1: Math.max(...all.map((one) => one.x1)) };
  }

  destroy(): void {
    this.feed?.stop();
    this.questions?.destroy();
    this.settings?.destroy();
    this.eventLoading.abort();
    if (this.timer !== null) clearTimeout(this.timer);
    for (const section of this.sections.values()) section.destroy();
    this.list.destroy();
    this.root.remove();
  }

  private showAll(nodes: readonly NodeItem[]): void {
    if (nodes.length === 0) {
      const detail = "Nodes appear here with their first message. Start one with: eskin node --config node.toml, or try eskin demo.";
      if (this.sections.size === 0) this.notices.show("empty", "No node has reported yet", detail);
      return;
    }
    this.notices.clear();
    this.partial = false;
    for (const { id, channels } of largestFirst(nodes)) {
      if (this.sections.has(id) || this.shared.has(id)) continue;
      if (this.sections.size < MOST_NODES && this.channels + (channels ?? 0) <= MOST_CHANNELS) {
        this.channels += channels ?? 0;
        this.addSection(id);
      } else this.partial = true;
    }
  }

  /** Begins the page of one node; of one that is not listed, it says what is wrong. */
  private addFirst(): void {
    this.notices.clear();
    this.addSection(this.scope.node!);
    if (this.settings !== null) this.column.append(this.settings.root);
    if (this.scope.channel !== null) this.column.prepend(crumbs(this.options.context, this.scope.node!, this.scope.channel));
  }

  private addSection(id: string): void {
    const { context } = this.options;
    const { channel } = this.scope;
    const common = {
      context,
      node: id,
      onPeak: (mark: PeakMark): void => this.openPeak(mark),
      onPanels: (fresh: boolean): void => this.onPanels(section, fresh),
      onSelection: (): void => this.onSelection(id),
    };
    const section: Section = channel === null ? new NodeSection({ ...common, brief: this.scope.node === null }) : new ChannelSection({ ...common, channel });
    this.sections.set(id, section);
    this.column.append(section.root);
  }

  /** A section has found out what it shows: all nodes that share a skin are shown by one section. */
  private onSelection(id: string): void {
    for (const node of this.sections.get(id)?.nodes ?? []) {
      if (node === id) continue;
      this.shared.add(node);
      this.sections.get(node)?.destroy();
      this.sections.delete(node);
    }
    this.connect();
  }

  private onPanels(section: Section, fresh: boolean): void {
    if (fresh) this.wantEvents();
    const { node, channel } = this.scope;
    const panel = channel === null ? undefined : section.panels.get(channel);
    if (node === null || !panel) return;
    if (this.questions === null) {
      this.questions = new ChannelQuestions(this.options.context, node, panel);
      panel.root.append(this.questions.root);
    }
    const facts = channelFacts(panel.data.channel);
    const shown = section.root.querySelector(".channel-facts");
    if (shown) shown.replaceWith(facts);
    else section.root.append(facts);
  }

  private openPeak(mark: PeakMark): void {
    const { context } = this.options;
    const { event } = mark;
    const middle = (mark.x0 + mark.x1) / 2;
    const half = Math.max(1e9, mark.x1 - mark.x0);
    const view = {
      kind: "history",
      from: context.timeline.toInstant(middle - half),
      to: context.timeline.toInstant(middle + half),
    } as const;
    context.go({ node: event.node, channel: event.channel, view, question: null });
  }

  /** Opens the live stream, or asks it for what is shown now. */
  private connect(): void {
    const { onUnreadable } = this.options;
    const sections = [...this.sections.values()];
    this.owners = new Map(sections.flatMap((section) => section.nodes.map((node) => [node, section] as const)));
    const nodes = [...this.owners.keys()].filter((node) => this.known.has(node));
    if (nodes.length === 0) return;
    const patches = sections.map((section) => section.patches);
    const selection = { nodes, patches: patches.includes(null) ? null : patches.flatMap((ids) => ids ?? []) };
    if (this.feed !== null) {
      this.feed.choose(selection);
      return;
    }
    const options = {
      url: (names: readonly string[], cursor: string | null): string => address("/live", { node: names, cursor }),
      onMessage: (message: LiveMessage): void => this.receive(message),
      onUnreadable,
      onState: (state: FeedState): void => this.takeState(state),
      onReplaced: (): void => location.reload(),
    };
    this.feed = new FrameFeed(options, selection);
    this.feed.start();
  }

  private takeState(state: FeedState): void {
    this.askWell(state);
    this.options.onFeed(state);
  }

  /** Loads events once the stream is open, so that none is missed; earlier only where it cannot open. */
  private askWell({ kind }: FeedState): void {
    if (kind === "connecting" || this.asked === "well" || (kind !== "open" && this.asked === "early")) return;
    this.asked = kind === "open" ? "well" : "early";
    void this.list.load();
    this.wantEvents();
  }

  private receive(message: LiveMessage): void {
    if (message.kind === "frame") this.owners.get(message.node)?.takeFrame(message.frame, message.received, performance.now());
    else if (message.kind === "contacts") this.owners.get(message.node)?.takeContacts(message.json);
    else if (message.kind === "event") this.takeEvent(JSON.parse(message.json) as EventItem);
    else if (message.kind === "lagging" && message.skipped !== 0) {
      this.missed = true;
      for (const section of this.sections.values()) section.takeSkipped(message.skipped);
    }
  }

  private takeEvent(event: EventItem): void {
    this.list.take(event);
    this.owners.get(event.node)?.takeEvent(event);
    if (event.kind === "status") this.options.onStatus();
    if (event.kind === "command") this.settings?.refresh();
  }

  /** The window that events are asked for: the one shown, or the newest data. */
  private eventWindow(): Range | null {
    const { view } = this.options.context.route();
    const extent = this.extent();
    if (view.kind === "history") return this.range();
    return extent && { x0: extent.x1 - 1.5 * view.span, x1: extent.x1 + view.span };
  }

  /** Asks for events soon, once for all charts that open and for all steps of a gesture meanwhile. */
  private wantEvents(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      // Before the stream is open it is too early: what comes until then would be missed.
      if (this.feed !== null && this.asked === "never") return;
      void this.loadEvents();
      if (this.asked !== "never") void this.list.follow();
    }, SETTLE_MS);
  }

  /** Loads the peaks and gaps of the window, for the charts that there are. */
  private async loadEvents(): Promise<void> {
    const { client, timeline } = this.options.context;
    const range = this.eventWindow();
    if (range === null || [...this.sections.values()].every(({ panels }) => panels.size === 0)) return;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)) };
    const scope = { node: this.scope.node ?? undefined, channel: this.scope.channel ?? undefined };
    this.eventLoading.abort();
    this.eventLoading = new AbortController();
    const { signal } = this.eventLoading;
    try {
      const lists = KINDS.map((kind) => client.eventsOf({ ...scope, ...window, kind }, EVENT_PAGES, signal));
      const found = await Promise.all(lists);
      for (const event of found.flatMap(({ items }) => items).toReversed()) {
        this.owners.get(event.node)?.takeEvent(event);
      }
      this.unmarked = found.flatMap(({ items, complete }, index) => {
        const oldest = complete ? undefined : items.at(-1);
        return oldest ? [{ kind: KINDS[index]!, since: timeline.toX(parseInstant(oldest.time.lo)) }] : [];
      });
    } catch (error) {
      // The event list shows the same failure, with a button to retry.
      if (!isAbort(error)) this.list.fail(error);
    }
  }

  /** Notes since when peaks are marked, while the window reaches further back. */
  private remark(): void {
    const range = this.range();
    const shown = this.unmarked.filter(({ since }) => range === null || range.x0 < since);
    const texts = shown.map(({ kind, since }) => {
      const from = this.options.context.timeline.toInstant(Math.ceil(since / SECOND) * SECOND);
      const day = range !== null && range.x1 - range.x0 > DAY ? `${printDay(from)} ` : "";
      return `Only ${kind}s from ${day}${printClock(from, 0)} on are marked in the charts: zoom in for all.`;
    });
    this.list.remark(texts.join(" "));
  }
}
