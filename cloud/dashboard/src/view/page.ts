import { address } from "../api/client";
import type { EventItem, LiveBlock, NodeItem } from "../api/contract";
import { isAbort } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { Feed, type FeedState } from "../live/feed";
import { FrameFeed, type LiveMessage } from "../live/frame-feed";
import type { Route } from "../state/route";
import type { Range } from "../state/window";
import { parseInstant, printClock, printDay } from "../time/instant";
import { Throttle, TEXT_MS } from "../time/throttle";
import { channelFacts, crumbs } from "./channel-detail";
import { ChannelQuestions } from "./channel-questions";
import type { Context } from "./context";
import { element } from "./element";
import { EventList } from "./event-list";
import { FrameChannelSection } from "./frame-channel-section";
import { NodeSection } from "./node-section";
import { NodeSettings } from "./node-settings";
import { NoticeBoard } from "./notice";
import type { FramedSection, Section } from "./section";
import { SkinSection } from "./skin-section";

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
/** Entries a block at most: of what can be seen, nothing is left out. */
const POINTS = 1_000;
/** The overview shows so many skins; the strip of nodes leads to all others. */
const MOST_SKINS = 4;
/** Of two streams, the state is shown that a user must know. */
const STATES: readonly FeedState["kind"][] = ["open", "connecting", "waiting", "offline"];

/** Everything below the nodes: the charts of one scope (all nodes, one node, one channel) and its events. */
export class Page {
  readonly root = element("main", { class: "page", tabindex: -1 });
  private readonly sections = new Map<string, Section>();
  /** Those whose channels come as frames. */
  private readonly framed = new Map<string, FramedSection>();
  private readonly column = element("div", { class: "column" });
  private readonly notices = new NoticeBoard(this.column);
  private readonly list: EventList;
  private readonly scope: { readonly node: string | null; readonly channel: string | null };
  private questions: ChannelQuestions | null = null;
  private readonly settings: NodeSettings | null = null;
  private feed: Feed | null = null;
  private frameFeed: FrameFeed | null = null;
  private frameNodes = "";
  private readonly states = new Map<"blocks" | "frames", FeedState>();
  private feedUrl = "";
  /** Whether events were loaded, and whether after the stream had opened. */
  private asked: "never" | "early" | "well" = "never";
  private eventLoading = new AbortController();
  /** Of which kinds there are too many events to mark, and since when they are marked. */
  private unmarked: { readonly kind: string; readonly since: number }[] = [];
  private readonly texts = new Throttle(TEXT_MS);
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
    else if (this.sections.size === 0) {
      this.addFirst(nodes.find(({ id }) => id === this.scope.node) ?? null);
    }
    for (const node of nodes) this.framed.get(node.id)?.showNode(node);
    this.connect();
  }

  /** Shows that the nodes could not be loaded; false where charts take the room. */
  showFailure(message: string, again: () => void): boolean {
    if (this.sections.size === 0 && this.scope.node !== null) {
      this.addFirst(null);
      this.connect();
    }
    if (this.sections.size > 0) return false;
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
    if (this.sections.size > 0) this.connect();
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.loadEvents(), SETTLE_MS);
  }

  frame(at: number): void {
    for (const section of this.sections.values()) section.frame(at);
    this.list.frame(at);
    this.questions?.frame(at);
    this.settings?.frame(at);
    if (this.texts.due(at)) this.remark();
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
    this.frameFeed?.stop();
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
    for (const node of nodes) {
      if (this.sections.has(node.id)) continue;
      if (!node.layout || this.framed.size < MOST_SKINS) this.addSection(node.id, node);
    }
  }

  /** Begins the page of one node; of one that is not listed, its charts say what is wrong. */
  private addFirst(node: NodeItem | null): void {
    this.notices.clear();
    this.addSection(this.scope.node!, node);
    // Where there is a skin, it is what a user comes for.
    if (this.settings !== null) {
      if (this.framed.size > 0) this.column.append(this.settings.root);
      else this.column.prepend(this.settings.root);
    }
    if (this.scope.channel !== null) this.column.prepend(crumbs(this.options.context, this.scope.node!, this.scope.channel));
  }

  private addSection(id: string, node: NodeItem | null): void {
    const { context } = this.options;
    const { channel } = this.scope;
    const onPeak = (mark: PeakMark): void => this.openPeak(mark);
    const onPanels = (fresh: boolean): void => this.onPanels(section, fresh);
    if (!node?.layout) {
      const section: Section = new NodeSection({ context, node: id, channel, framed: false, onPeak, onPanels: (fresh) => this.onPanels(section, fresh) });
      this.sections.set(id, section);
      this.column.append(section.root);
      return;
    }
    const section: FramedSection =
      channel === null
        ? new SkinSection({ context, node, brief: this.scope.node === null, onPeak, onPanels })
        : new FrameChannelSection({ context, node, channel, onPeak, onPanels, onPatch: (patch) => this.frameFeed?.choose([patch]) });
    const others = [...this.sections.values()].find((other) => other instanceof NodeSection);
    this.sections.set(id, section);
    this.framed.set(id, section);
    if (others) others.root.before(section.root);
    else this.column.append(section.root);
  }

  private onPanels(section: Section, fresh: boolean): void {
    if (fresh) void this.loadEvents();
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

  /** Opens the streams of the nodes that are shown: of blocks as events, of frames over a WebSocket. */
  private connect(): void {
    this.connectFrames();
    const { context } = this.options;
    const { node, channel } = this.scope;
    const blocks = [...this.sections.keys()].filter((id) => !this.framed.has(id));
    if (this.framed.size > 0 && blocks.length === 0) return;
    const { view } = context.route();
    const span = view.kind === "live" ? view.span : 10e9;
    // No finer than half a pixel of the widest chart there can be, and the same for windows of about one length.
    const grain = 2 ** Math.floor(Math.log2(Math.max(1, span / screen.width / 2)));
    const scope = channel === null ? { node: this.framed.size > 0 ? blocks : node } : { channel: `${node}/${channel}` };
    const url = address("/live", { ...scope, points: POINTS, grain });
    if (url === this.feedUrl) return;
    this.feedUrl = url;
    // The second feed resumes after the first, so that no event is lost between them.
    const after = this.feed?.cursor ?? null;
    this.feed?.stop();
    this.feed = new Feed({
      url,
      after,
      fetch: (input, init) => fetch(input, init),
      random: Math.random,
      onMessage: ({ event, data }) => this.receive(event, data),
      onState: (state) => this.takeState("blocks", state),
      onUnauthorised: context.onUnauthorised,
    });
    this.feed.start();
  }

  private connectFrames(): void {
    const nodes = [...this.framed.keys()];
    if (nodes.length === 0 || nodes.join(" ") === this.frameNodes) return;
    this.frameNodes = nodes.join(" ");
    this.frameFeed?.stop();
    this.frameFeed = new FrameFeed({
      nodes,
      url: (cursor) => address("/live", { node: nodes, cursor }),
      onMessage: (message) => this.receiveLive(message),
      onUnreadable: () => this.options.onUnreadable(),
      onState: (state) => this.takeState("frames", state),
    });
    this.frameFeed.start();
  }

  private takeState(stream: "blocks" | "frames", state: FeedState): void {
    this.states.set(stream, state);
    const worst = [...this.states.values()].toSorted((one, other) => STATES.indexOf(other.kind) - STATES.indexOf(one.kind))[0]!;
    this.askWell(worst);
    this.options.onFeed(worst);
  }

  /** Loads events once the stream is open, so that none is missed; earlier only where it cannot open. */
  private askWell({ kind }: FeedState): void {
    if (kind === "connecting" || this.asked === "well" || (kind !== "open" && this.asked === "early")) return;
    this.asked = kind === "open" ? "well" : "early";
    void this.list.load();
    void this.loadEvents();
  }

  private receiveLive(message: LiveMessage): void {
    if (message.kind === "frame") this.framed.get(message.node)?.takeFrame(message.frame, message.received, performance.now());
    else if (message.kind === "contacts") this.framed.get(message.node)?.takeContacts(message.json);
    else if (message.kind === "event") this.receive(message.event, message.json);
    else if (message.kind === "lagging" && message.skipped > 0) {
      for (const section of this.framed.values()) section.takeSkipped(message.skipped);
    }
  }

  private receive(kind: string, data: string): void {
    const at = performance.now();
    try {
      if (kind === "block") {
        const block = JSON.parse(data) as LiveBlock;
        this.sections.get(block.node)?.take(block, at);
      } else if (["peak", "gap", "status", "command", "conflict"].includes(kind)) {
        const event = JSON.parse(data) as EventItem;
        this.list.take(event);
        this.sections.get(event.node)?.takeEvent(event);
        if (event.kind === "status") this.options.onStatus();
        if (event.kind === "command") this.settings?.refresh();
      } else if (kind === "lagging") {
        for (const section of this.sections.values()) section.refill();
        void this.list.refresh();
        void this.loadEvents();
      }
    } catch (error) {
      if (!(error instanceof SyntaxError || error instanceof RangeError || error instanceof TypeError)) throw error;
      this.options.onUnreadable();
    }
  }

  /** The window that events are asked for: the one shown, or the newest data. */
  private eventWindow(): Range | null {
    const { view } = this.options.context.route();
    const extent = this.extent();
    if (view.kind === "history") return this.range();
    return extent && { x0: extent.x1 - 1.5 * view.span, x1: extent.x1 + view.span };
  }

  /** Loads the peaks and gaps of the window, for the charts. */
  private async loadEvents(): Promise<void> {
    const { client, timeline } = this.options.context;
    const range = this.eventWindow();
    if (range === null) return;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)) };
    const scope = { node: this.scope.node ?? undefined, channel: this.scope.channel ?? undefined };
    this.eventLoading.abort();
    this.eventLoading = new AbortController();
    const { signal } = this.eventLoading;
    try {
      const lists = KINDS.map((kind) => client.eventsOf({ ...scope, ...window, kind }, EVENT_PAGES, signal));
      const found = await Promise.all(lists);
      for (const event of found.flatMap(({ items }) => items).toReversed()) {
        this.sections.get(event.node)?.takeEvent(event);
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
