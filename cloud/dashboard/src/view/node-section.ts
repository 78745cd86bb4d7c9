import type { ChannelItem, EventItem, LiveBlock } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { LiveEdge } from "../live/edge";
import { printRoute, type View } from "../state/route";
import type { Range } from "../state/window";
import { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { element } from "./element";
import { NoticeBoard } from "./notice";
import type { Section } from "./section";
import { SkinPicture } from "./skin-picture";

export interface SectionOptions {
  readonly context: Context;
  readonly node: string;
  /** Only this channel, alone and large. */
  readonly channel: string | null;
  /** Whether the node's channels come as frames: there may be thousands, so only this one is asked for. */
  readonly framed: boolean;
  readonly onPeak: (mark: PeakMark) => void;
  /** Called when the channels were listed; `fresh` if there are new ones among them. */
  readonly onPanels: (fresh: boolean) => void;
}

const RETRY_MS = 5_000;
const REFRESH_MS = 10_000;

/** The charts of one node; they share one moving edge of time. */
export class NodeSection implements Section {
  readonly root: HTMLElement;
  readonly panels = new Map<string, ChannelPanel>();
  channels: readonly ChannelItem[] = [];
  private readonly grid = element("div", { class: "grid" });
  /** Speaks in the place of panels, as long as there are none. */
  private readonly notices = new NoticeBoard(this.grid);
  private readonly edge = new LiveEdge();
  private readonly picture: SkinPicture | null;
  private readonly loading = new AbortController();
  private loadedAt: number | null = null;
  private retry: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: SectionOptions) {
    const { context, node, channel } = options;
    const href = printRoute({ ...context.route(), node, channel: null, question: null });
    this.picture = channel === null ? new SkinPicture(context, node, this.edge) : null;
    const head = channel === null ? element("h2", { class: "section-head" }, element("a", { href }, node)) : null;
    this.root = element("section", { class: channel === null ? "node-section" : "node-section alone", "data-node": node }, head, this.picture?.root, this.grid);
    this.notices.show("loading", "Loading channels…", "");
    void this.load();
  }

  apply(view: View): void {
    this.picture?.apply(view);
    for (const panel of this.panels.values()) panel.apply(view);
  }

  /** Asks for what is shown again, after the stream has left something out. */
  refill(): void {
    for (const panel of this.panels.values()) panel.startLive();
  }

  frame(at: number): void {
    if (this.loadedAt !== null && at - this.loadedAt > REFRESH_MS) {
      this.loadedAt = null;
      void this.load();
    }
    this.picture?.frame(at);
    for (const panel of this.panels.values()) panel.frame(at);
  }

  /** Takes a live block; a channel that is new makes the section ask for the list again. */
  take(block: LiveBlock, at: number): void {
    this.picture?.take(block, at);
    const panel = this.panels.get(block.channel);
    if (panel) panel.take(block, at);
    else if (this.options.channel === null && this.retry === null) this.loadAgain(1_000);
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
    for (const panel of this.panels.values()) panel.repaint();
  }

  /** The window that the first chart shows. */
  range(): Range | null {
    for (const panel of this.panels.values()) {
      const range = panel.range();
      if (range) return range;
    }
    return null;
  }

  /** The stretch of time from the first to the last sample of all channels. */
  extent(): Range | null {
    const all = [...this.panels.values()].map(({ data }) => data.extent).filter((one) => one !== null);
    if (all.length === 0) return null;
    return { x0: Math.min(...all.map((one) => one.x0)), x1: Math.max(...all.map((one) => one.x1)) };
  }

  destroy(): void {
    this.loading.abort();
    this.picture?.destroy();
    if (this.retry !== null) clearTimeout(this.retry);
    for (const panel of this.panels.values()) panel.destroy();
    this.root.remove();
  }

  private loadAgain(delay: number): void {
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = setTimeout(() => {
      this.retry = null;
      void this.load();
    }, delay);
  }

  private async load(): Promise<void> {
    const { context, node, channel, framed } = this.options;
    try {
      this.channels = await context.client.channels(node, this.loading.signal, framed && channel !== null ? channel : undefined);
    } catch (error) {
      if (isAbort(error)) return;
      if (this.panels.size === 0) this.sayFailure(messageOf(error));
      this.loadAgain(RETRY_MS);
      return;
    }
    this.loadedAt = performance.now();
    this.showPanels();
  }

  private sayFailure(message: string): void {
    const act = (): void => {
      this.notices.show("loading", "Loading channels…", "");
      this.loadAgain(0);
    };
    this.notices.show("error", `The channels of ${this.options.node} could not be loaded`, message, { label: "Try again", act });
  }

  private showPanels(): void {
    const { channel: only, node } = this.options;
    const wanted = this.channels.filter((channel) => only === null || channel.id === only);
    this.picture?.show(this.channels);
    const fresh = wanted.filter((channel) => !this.panels.has(channel.id));
    if (wanted.length > 0) this.notices.clear();
    for (const channel of wanted) {
      const panel = this.panels.get(channel.id);
      if (panel) panel.data.channel = channel;
    }
    for (const channel of fresh) {
      const { context, onPeak } = this.options;
      const panel = new ChannelPanel({ context, node, channel, edge: this.edge, alone: only !== null, onPeak });
      this.panels.set(channel.id, panel);
      this.grid.append(panel.root);
    }
    if (this.panels.size === 0) {
      const title = only === null ? `${node} has no channels yet` : `${node} has no channel "${only}"`;
      this.notices.show("empty", title, "Channels appear with the first block that a node sends.");
      this.loadAgain(3_000);
    }
    this.options.onPanels(fresh.length > 0);
  }
}
