import type { EventItem, LayoutItem, NodeItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { LiveEdge } from "../live/edge";
import { type Column, columnOf, runOf } from "../skin/column-series";
import { quantitiesIn } from "../skin/layout";
import { NodeFrames } from "../skin/node-frames";
import type { Stretch } from "../skin/stretches";
import { printRoute, type View } from "../state/route";
import type { Range } from "../state/window";
import { ChannelBrowser } from "./channel-browser";
import { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { button, element, setText } from "./element";
import { NodeReflexes } from "./node-reflexes";
import { NoticeBoard } from "./notice";
import type { Section } from "./section";
import { SkinView } from "./skin-view";

/** So many taxels have charts at a time. */
export const MOST_CHARTS = 12;
const RETRY_MS = 5_000;

export interface NodeSectionOptions {
  readonly context: Context;
  readonly node: string;
  /** Among other nodes: the picture alone, or charts where there is none. */
  readonly brief: boolean;
  readonly onPeak: (mark: PeakMark) => void;
  readonly onPanels: (fresh: boolean) => void;
  /** It is known which nodes share the skin. */
  readonly onSelection: () => void;
}

/** A node: its skin, the charts of chosen taxels and of channels that no picture shows, and the list of all channels. */
export class NodeSection implements Section {
  readonly root: HTMLElement;
  readonly panels = new Map<string, ChannelPanel>();
  readonly patches = null;
  /** All nodes that share the skin. */
  nodes: readonly string[];
  private readonly frames: NodeFrames;
  private readonly skin: SkinView;
  private readonly browser: ChannelBrowser | null;
  private readonly reflexes: NodeReflexes | null;
  private readonly edge = new LiveEdge();
  /** The charts that are open or being opened, by their channels. */
  private readonly columns = new Map<string, Column>();
  private readonly grid = element("div", { class: "grid" });
  private readonly note = element("p", { class: "skin-note", role: "status" });
  private readonly chosen: HTMLElement;
  /** Charts that are always there: of channels that no picture shows. */
  private readonly others = element("div", { class: "grid", hidden: true });
  private readonly notices: NoticeBoard;
  private readonly title: HTMLElement;
  private readonly watcher: IntersectionObserver;
  private visible = true;
  private readonly loading = new AbortController();
  private retry: ReturnType<typeof setTimeout> | null = null;
  /** The channels whose charts are to be there, each with the node that sends it, and those of them that always are. */
  private wanted: ReadonlyMap<string, string> = new Map();
  private standing: ReadonlyMap<string, string> = new Map();

  constructor(private readonly options: NodeSectionOptions) {
    const { context, node, brief } = options;
    this.nodes = [node];
    this.frames = new NodeFrames({
      client: context.client,
      timeline: context.timeline,
      node,
      onLayout: (layout) => this.useLayout(layout),
      onFailure: (message) => this.notices.show("error", "The layout could not be loaded", message),
      onStretch: (stretch, at) => this.takeStretch(stretch, at),
    });
    this.skin = new SkinView({
      context,
      node,
      frames: this.frames,
      gestures: !brief,
      onSelect: (taxels, adds) => this.choose(taxels, adds),
      onEscape: () => this.open([]),
      onQuantity: () => this.showPanels(),
    });
    this.skin.root.hidden = true;
    const close = button("Close charts", { class: "plain", "data-testid": "close-charts" }, () => this.open([]));
    this.chosen = element("div", { class: "skin-chosen", hidden: true }, element("div", { class: "skin-chosen-head" }, this.note, close), this.grid);
    this.browser = brief ? null : new ChannelBrowser(context);
    this.reflexes = brief ? null : new NodeReflexes(context, node);
    const href = printRoute({ ...context.route(), node, channel: null, question: null });
    this.title = element("a", { href }, node);
    const space = element("div", { class: "grid" });
    this.notices = new NoticeBoard(space);
    this.root = element("section", { class: "node-section skin-section", "data-node": node }, element("h2", { class: "section-head" }, this.title), space, this.reflexes?.root, this.skin.root, this.chosen, this.others, this.skin.gestureList, this.browser?.root);
    this.watcher = new IntersectionObserver((changes) => {
      this.visible = changes.at(-1)?.isIntersecting ?? false;
      this.skin.setVisible(this.visible);
    });
    this.watcher.observe(this.skin.root);
    this.notices.show("loading", "Loading the layout…", "");
  }

  apply(view: View): void {
    this.skin.apply(view);
    this.showPanels();
    for (const panel of this.panels.values()) panel.apply(view);
  }

  showNode(node: NodeItem): void {
    if (node.layout) this.frames.useLayout(node.layout);
    else if (this.frames.layout === null) this.notices.show("empty", `${node.id} has no channels yet`, "Channels appear with the first frame that a node sends.");
  }

  showFailure(message: string): void {
    if (this.frames.layout === null) this.notices.show("error", `${this.options.node} could not be loaded`, message);
  }

  showAbsence(): void {
    if (this.frames.layout === null) this.notices.show("error", `There is no node "${this.options.node}"`, "Check the name in the address, or choose one of the nodes above. A node appears there with its first message.");
  }

  takeFrame(data: Uint8Array, received: number, at: number): void {
    // What is scrolled away needs no picture.
    if (this.visible || this.panels.size > 0 || this.browser?.open) this.frames.takeFrame(data, received, at);
  }

  takeSkipped(frames: number | null): void {
    this.skin.takeSkipped(frames);
    for (const panel of this.panels.values()) panel.takeSkipped();
  }

  takeContacts(json: string): void {
    this.frames.takeContacts(json);
  }

  frame(at: number): void {
    this.skin.frame(at);
    this.reflexes?.frame(at);
    this.browser?.frame(at, this.skin.isPresent(at) ? this.frames.stretches : null);
    for (const panel of this.panels.values()) panel.frame(at);
  }

  takeEvent(event: EventItem): void {
    if (event.kind === "verdict" || event.kind === "command" || event.kind === "status") this.reflexes?.refresh();
    for (const panel of this.panels.values()) panel.takeEvent(event);
  }

  repaint(): void {
    this.skin.repaint();
    for (const panel of this.panels.values()) panel.repaint();
  }

  range(): Range | null {
    return this.skin.range();
  }

  extent(): Range | null {
    const { begin, end } = this.frames.stretches;
    const all = [...this.panels.values()].map(({ data }) => data.extent).filter((one) => one !== null);
    if (begin !== null && end !== null) all.push({ x0: begin, x1: end });
    if (all.length === 0) return null;
    return { x0: Math.min(...all.map(({ x0 }) => x0)), x1: Math.max(...all.map(({ x1 }) => x1)) };
  }

  destroy(): void {
    this.loading.abort();
    if (this.retry !== null) clearTimeout(this.retry);
    this.watcher.disconnect();
    this.frames.destroy();
    this.reflexes?.destroy();
    this.skin.destroy();
    for (const panel of this.panels.values()) panel.destroy();
    this.root.remove();
  }

  private useLayout(layout: LayoutItem): void {
    const { node, brief, onSelection } = this.options;
    this.notices.clear();
    this.skin.root.hidden = quantitiesIn(layout).length === 0;
    this.skin.useLayout(layout);
    this.browser?.show(layout);
    this.standing = standingIn(layout, brief);
    this.showPanels();
    const sharing = layout.controllers.map((controller) => controller.node);
    this.nodes = sharing.includes(node) ? sharing : [node];
    setText(this.title, this.nodes.join(" · "));
    onSelection();
  }

  private takeStretch(stretch: Stretch, at: number): void {
    const { timeline } = this.options.context;
    for (const [channel, panel] of this.panels) {
      const run = runOf(stretch, this.columns.get(channel)!, timeline);
      if (run !== null) panel.take(run, at);
    }
    this.edge.observe(stretch.end, at);
  }

  /** Opens the charts of taxels that were clicked, or that lie in a box. */
  private choose(taxels: readonly string[], adds: boolean): void {
    const before = adds ? (this.options.context.route().taxels ?? []) : [];
    const single = taxels.length === 1 ? taxels[0]! : null;
    if (adds && single !== null && before.includes(single)) {
      this.open(before.filter((taxel) => taxel !== single));
      return;
    }
    const all = [...new Set([...before, ...this.skin.hardest(taxels)])];
    const kept = all.slice(0, MOST_CHARTS);
    const rest = all.length - kept.length;
    setText(this.note, rest > 0 ? `The ${MOST_CHARTS} hardest pressed of ${all.length.toLocaleString("en")} taxels` : "Charts");
    this.open(kept);
  }

  private open(taxels: readonly string[]): void {
    const { context, node } = this.options;
    context.go({ ...context.route(), node, channel: null, question: null, taxels }, "replace");
  }

  /** Makes the charts that the address names and those that are always there, and closes all others. */
  private showPanels(): void {
    const { context, brief } = this.options;
    if (this.frames.layout === null) return;
    const taxels = brief ? [] : (context.route().taxels ?? []).slice(0, MOST_CHARTS);
    const chosen = this.skin.channelsOf(taxels);
    this.wanted = new Map([...chosen, ...this.standing]);
    for (const [channel, panel] of this.panels) {
      if (this.wanted.has(channel)) continue;
      panel.destroy();
      panel.root.remove();
      this.panels.delete(channel);
    }
    for (const channel of this.columns.keys()) if (!this.wanted.has(channel)) this.columns.delete(channel);
    for (const [channel, node] of this.wanted) {
      const panel = this.panels.get(channel);
      const grid = this.gridOf(channel);
      if (panel === undefined) void this.openChart(channel, node);
      else if (panel.root.parentElement !== grid) grid.append(panel.root);
    }
    this.chosen.hidden = ![...chosen.keys()].some((channel) => !this.standing.has(channel));
    this.others.hidden = this.standing.size === 0;
    if (!brief) this.skin.select(taxels);
  }

  private gridOf(channel: string): HTMLElement {
    return this.standing.has(channel) ? this.others : this.grid;
  }

  private async openChart(channel: string, node: string): Promise<void> {
    const { context, onPeak, onPanels } = this.options;
    const { layout } = this.frames;
    const column = layout && columnOf(layout, node, channel);
    if (column === null || this.columns.has(channel)) return;
    this.columns.set(channel, column);
    try {
      const found = await context.client.channels(node, this.loading.signal, channel);
      const facts = found.find(({ id }) => id === channel);
      if (!this.wanted.has(channel) || this.panels.has(channel)) return;
      if (facts === undefined) {
        this.columns.delete(channel);
        return;
      }
      const panel = new ChannelPanel({ context, node, channel: facts, edge: this.edge, alone: false, onPeak });
      this.panels.set(channel, panel);
      const order = [...this.wanted.keys()];
      const grid = this.gridOf(channel);
      const after = [...grid.children].find((child) => order.indexOf(child.getAttribute("data-channel") ?? "") > order.indexOf(channel));
      grid.insertBefore(panel.root, after ?? null);
      this.notices.clear();
      onPanels(true);
    } catch (error) {
      this.columns.delete(channel);
      if (!isAbort(error)) this.sayFailure(node, messageOf(error));
    }
  }

  /** Says that charts could not be opened, and opens them later. */
  private sayFailure(node: string, message: string): void {
    const act = (): void => {
      this.notices.clear();
      this.showPanels();
    };
    this.notices.show("error", `The channels of ${node} could not be loaded`, message, { label: "Try again", act });
    this.retry ??= setTimeout(() => {
      this.retry = null;
      this.showPanels();
    }, RETRY_MS);
  }
}

/** The channels whose charts are always there: all of a few; else those that no picture shows, if they are few. */
function standingIn(layout: LayoutItem, brief: boolean): ReadonlyMap<string, string> {
  const total = layout.patches.reduce((sum, { taxels }) => sum + taxels.length, 0);
  const pictured = new Set(quantitiesIn(layout));
  if (brief && pictured.size > 0) return new Map();
  const patches = layout.patches.filter(({ quantity }) => total <= MOST_CHARTS || !pictured.has(quantity));
  const all = patches.flatMap(({ taxels, quantity, node }) => taxels.map((taxel) => [`${taxel}.${quantity}`, node] as const));
  return new Map(all.slice(0, MOST_CHARTS));
}
