import type { EventItem, LayoutItem, LiveBlock, NodeItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { LiveEdge } from "../live/edge";
import { blockOf, type Column, columnOf } from "../skin/column-series";
import { NodeFrames } from "../skin/node-frames";
import type { Stretch } from "../skin/stretches";
import { printRoute, type View } from "../state/route";
import type { Range } from "../state/window";
import { ChannelBrowser } from "./channel-browser";
import { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { button, element, setText } from "./element";
import type { FramedSection } from "./section";
import { SkinView } from "./skin-view";

/** So many taxels have charts at a time. */
export const MOST_CHARTS = 12;

export interface SkinSectionOptions {
  readonly context: Context;
  readonly node: NodeItem;
  /** Among other nodes: the picture alone. */
  readonly brief: boolean;
  readonly onPeak: (mark: PeakMark) => void;
  readonly onPanels: (fresh: boolean) => void;
}

/** A node whose channels come as frames: its skin, the charts of chosen taxels, and the list of all channels. */
export class SkinSection implements FramedSection {
  readonly root: HTMLElement;
  readonly panels = new Map<string, ChannelPanel>();
  private readonly frames: NodeFrames;
  private readonly skin: SkinView;
  private readonly browser: ChannelBrowser | null;
  private readonly edge = new LiveEdge();
  private readonly columns = new Map<string, Column>();
  private readonly grid = element("div", { class: "grid" });
  private readonly note = element("p", { class: "skin-note", role: "status" });
  private readonly chosen: HTMLElement;
  private readonly watcher: IntersectionObserver;
  private visible = true;
  private readonly loading = new AbortController();
  /** The channels whose charts the address names. */
  private wanted: readonly string[] = [];

  constructor(private readonly options: SkinSectionOptions) {
    const { context, node, brief } = options;
    this.frames = new NodeFrames({
      client: context.client,
      timeline: context.timeline,
      node: node.id,
      onLayout: (layout) => this.useLayout(layout),
      onFailure: (message) => this.skin.failLayout(message),
      onStretch: (stretch, at) => this.takeStretch(stretch, at),
    });
    this.skin = new SkinView({
      context,
      node: node.id,
      frames: this.frames,
      onSelect: (taxels, adds) => this.choose(taxels, adds),
      onEscape: () => this.open([]),
      onQuantity: () => this.showPanels(),
    });
    const close = button("Close charts", { class: "plain", "data-testid": "close-charts" }, () => this.open([]));
    this.chosen = element("div", { class: "skin-chosen", hidden: true }, element("div", { class: "skin-chosen-head" }, this.note, close), this.grid);
    this.browser = brief ? null : new ChannelBrowser(context, node.id);
    const href = printRoute({ ...context.route(), node: node.id, channel: null, question: null });
    const head = element("h2", { class: "section-head" }, element("a", { href }, node.id));
    this.root = element("section", { class: "node-section skin-section", "data-node": node.id }, head, this.skin.root, this.chosen, this.browser?.root);
    this.watcher = new IntersectionObserver((changes) => {
      this.visible = changes.at(-1)?.isIntersecting ?? false;
      this.skin.setVisible(this.visible);
    });
    this.watcher.observe(this.skin.root);
    if (node.layout) this.frames.useLayout(node.layout);
  }

  apply(view: View): void {
    this.skin.apply(view);
    this.showPanels();
    for (const panel of this.panels.values()) panel.apply(view);
  }

  showNode(node: NodeItem): void {
    if (node.layout) this.frames.useLayout(node.layout);
  }

  takeFrame(data: Uint8Array, received: number, at: number): void {
    // A skin that is scrolled away needs no picture.
    if (this.visible || this.panels.size > 0) this.frames.takeFrame(data, received, at);
  }

  takeSkipped(frames: number): void {
    this.skin.takeSkipped(frames);
    this.refill();
  }

  takeContacts(json: string): void {
    this.frames.takeContacts(json);
  }

  refill(): void {
    for (const panel of this.panels.values()) panel.startLive();
  }

  frame(at: number): void {
    this.skin.frame(at);
    for (const panel of this.panels.values()) panel.frame(at);
  }

  take(block: LiveBlock, at: number): void {
    this.panels.get(block.channel)?.take(block, at);
  }

  takeEvent(event: EventItem): void {
    const live = this.options.context.route().view.kind === "live";
    for (const [channel, panel] of this.panels) {
      if (event.channel !== null && event.channel !== channel) continue;
      panel.data.takeEvent(event, live ? null : panel.range());
      panel.touch();
    }
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
    return begin === null || end === null ? null : { x0: begin, x1: end };
  }

  destroy(): void {
    this.loading.abort();
    this.watcher.disconnect();
    this.frames.destroy();
    this.skin.destroy();
    for (const panel of this.panels.values()) panel.destroy();
    this.root.remove();
  }

  private useLayout(layout: LayoutItem): void {
    this.skin.useLayout(layout);
    this.browser?.show(layout);
    this.showPanels();
  }

  private takeStretch(stretch: Stretch, at: number): void {
    const { timeline } = this.options.context;
    for (const [channel, panel] of this.panels) {
      const block = blockOf(stretch, this.columns.get(channel)!, timeline);
      if (block !== null) panel.take(block, at);
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
    context.go({ ...context.route(), node: node.id, channel: null, question: null, taxels }, "replace");
  }

  /** Makes the charts that the address names, and closes all others. */
  private showPanels(): void {
    const { context, brief } = this.options;
    if (brief || this.frames.layout === null) return;
    const taxels = (context.route().taxels ?? []).slice(0, MOST_CHARTS);
    this.wanted = taxels.map((taxel) => `${taxel}.${this.skin.quantity}`);
    for (const [channel, panel] of this.panels) {
      if (this.wanted.includes(channel)) continue;
      panel.destroy();
      panel.root.remove();
      this.panels.delete(channel);
      this.columns.delete(channel);
    }
    for (const channel of this.wanted) if (!this.panels.has(channel)) void this.openChart(channel);
    this.chosen.hidden = this.wanted.length === 0;
    this.skin.select(taxels);
  }

  private async openChart(channel: string): Promise<void> {
    const { context, node, onPeak, onPanels } = this.options;
    const { layout } = this.frames;
    const column = layout && columnOf(layout, node.id, channel);
    if (column === null || this.columns.has(channel)) return;
    this.columns.set(channel, column);
    try {
      const found = await context.client.channels(node.id, this.loading.signal, channel);
      const facts = found.find(({ id }) => id === channel);
      if (!this.wanted.includes(channel) || this.panels.has(channel)) return;
      if (facts === undefined) {
        this.columns.delete(channel);
        return;
      }
      const panel = new ChannelPanel({ context, node: node.id, channel: facts, edge: this.edge, alone: false, onPeak });
      this.panels.set(channel, panel);
      this.grid.append(panel.root);
      onPanels(true);
    } catch (error) {
      this.columns.delete(channel);
      if (!isAbort(error)) setText(this.note, `The chart of ${channel} could not be opened: ${messageOf(error)}`);
    }
  }
}
