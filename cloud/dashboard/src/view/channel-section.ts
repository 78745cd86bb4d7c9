import type { ChannelItem, EventItem, NodeItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import type { PeakMark } from "../chart/peaks";
import { LiveEdge } from "../live/edge";
import { type Column, columnOf, runOf } from "../skin/column-series";
import { NodeFrames } from "../skin/node-frames";
import type { View } from "../state/route";
import type { Range } from "../state/window";
import { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { element } from "./element";
import { NoticeBoard } from "./notice";
import type { Section } from "./section";

export interface ChannelSectionOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: string;
  readonly onPeak: (mark: PeakMark) => void;
  /** What the store knows of the channel was loaded; `fresh` if its chart was made just now. */
  readonly onPanels: (fresh: boolean) => void;
  /** It is known which patch the channel is a column of: others need not be sent. */
  readonly onSelection: () => void;
}

const RETRY_MS = 5_000;
const UNLISTED_MS = 3_000;
const REFRESH_MS = 10_000;

/** One channel, alone and large: its samples are a column of a patch. */
export class ChannelSection implements Section {
  readonly root: HTMLElement;
  readonly panels = new Map<string, ChannelPanel>();
  readonly nodes: readonly string[];
  private readonly frames: NodeFrames;
  private readonly grid = element("div", { class: "grid" });
  /** Speaks in the place of the chart, as long as there is none. */
  private readonly notices = new NoticeBoard(this.grid);
  private readonly edge = new LiveEdge();
  private readonly loading = new AbortController();
  private column: Column | null = null;
  private loadedAt: number | null = null;
  private retry: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: ChannelSectionOptions) {
    const { context, node, channel, onSelection } = options;
    this.nodes = [node];
    this.root = element("section", { class: "node-section alone", "data-node": node }, this.grid);
    this.frames = new NodeFrames({
      client: context.client,
      timeline: context.timeline,
      node,
      onLayout: (layout) => {
        this.column = columnOf(layout, node, channel);
        onSelection();
      },
      // The channel is asked of the same cloud, and says what is wrong.
      onFailure: () => undefined,
      onStretch: (stretch, at) => {
        const run = this.column && runOf(stretch, this.column, context.timeline);
        if (run) this.panels.get(channel)?.take(run, at);
      },
    });
    this.notices.show("loading", "Loading the channel…", "");
    void this.load();
  }

  get patches(): readonly string[] | null {
    return this.column && [this.column.patchId];
  }

  showNode(node: NodeItem): void {
    if (node.layout) this.frames.useLayout(node.layout);
  }

  showFailure(): void {
    // The channel is asked of the same cloud, and says what is wrong.
  }

  showAbsence(): void {
    // As above.
  }

  takeFrame(data: Uint8Array, received: number, at: number): void {
    this.frames.takeFrame(data, received, at);
  }

  takeContacts(): void {
    // A chart shows none.
  }

  takeSkipped(): void {
    for (const panel of this.panels.values()) panel.takeSkipped();
  }

  takeEvent(event: EventItem): void {
    for (const panel of this.panels.values()) panel.takeEvent(event);
  }

  apply(view: View): void {
    for (const panel of this.panels.values()) panel.apply(view);
  }

  frame(at: number): void {
    if (this.loadedAt !== null && at - this.loadedAt > REFRESH_MS) {
      this.loadedAt = null;
      void this.load();
    }
    for (const panel of this.panels.values()) panel.frame(at);
  }

  repaint(): void {
    for (const panel of this.panels.values()) panel.repaint();
  }

  range(): Range | null {
    return this.panels.get(this.options.channel)?.range() ?? null;
  }

  extent(): Range | null {
    return this.panels.get(this.options.channel)?.data.extent ?? null;
  }

  destroy(): void {
    this.loading.abort();
    this.frames.destroy();
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
    const { context, node, channel } = this.options;
    let found: readonly ChannelItem[];
    try {
      found = await context.client.channels(node, this.loading.signal, channel);
    } catch (error) {
      if (isAbort(error)) return;
      if (this.panels.size === 0) this.sayFailure(messageOf(error));
      this.loadAgain(RETRY_MS);
      return;
    }
    this.loadedAt = performance.now();
    this.show(found.find(({ id }) => id === channel) ?? null);
  }

  private sayFailure(message: string): void {
    const act = (): void => {
      this.notices.show("loading", "Loading the channel…", "");
      this.loadAgain(0);
    };
    this.notices.show("error", `The channel of ${this.options.node} could not be loaded`, message, { label: "Try again", act });
  }

  private show(facts: ChannelItem | null): void {
    const { context, node, channel, onPeak, onPanels } = this.options;
    const panel = this.panels.get(channel);
    if (facts === null) {
      if (panel) return;
      this.notices.show("empty", `${node} has no channel "${channel}"`, "Channels appear with the first frame that a node sends.");
      this.loadAgain(UNLISTED_MS);
      return;
    }
    if (panel) panel.data.channel = facts;
    else {
      this.notices.clear();
      const made = new ChannelPanel({ context, node, channel: facts, edge: this.edge, alone: true, onPeak });
      this.panels.set(channel, made);
      this.grid.append(made.root);
    }
    onPanels(!panel);
  }
}
