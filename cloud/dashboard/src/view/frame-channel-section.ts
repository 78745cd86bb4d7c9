import type { EventItem, LiveBlock, NodeItem } from "../api/contract";
import type { PeakMark } from "../chart/peaks";
import { blockOf, type Column, columnOf } from "../skin/column-series";
import { NodeFrames } from "../skin/node-frames";
import type { View } from "../state/route";
import type { Range } from "../state/window";
import type { ChannelPanel } from "./channel-panel";
import type { Context } from "./context";
import { NodeSection } from "./node-section";
import type { FramedSection } from "./section";

export interface FrameChannelOptions {
  readonly context: Context;
  readonly node: NodeItem;
  readonly channel: string;
  readonly onPeak: (mark: PeakMark) => void;
  readonly onPanels: (fresh: boolean) => void;
  /** The patch that the channel is a column of is known: others need not be sent. */
  readonly onPatch: (patch: string) => void;
}

/** One channel of a node whose channels come as frames: its samples are a column of a patch. */
export class FrameChannelSection implements FramedSection {
  private readonly inner: NodeSection;
  private readonly frames: NodeFrames;
  private column: Column | null = null;

  constructor(options: FrameChannelOptions) {
    const { context, node, channel, onPeak, onPanels, onPatch } = options;
    this.inner = new NodeSection({ context, node: node.id, channel, framed: true, onPeak, onPanels });
    this.frames = new NodeFrames({
      client: context.client,
      timeline: context.timeline,
      node: node.id,
      onLayout: (layout) => {
        this.column = columnOf(layout, node.id, channel);
        if (this.column !== null) onPatch(this.column.patchId);
      },
      // The list of channels comes from the same cloud, and says what is wrong.
      onFailure: () => undefined,
      onStretch: (stretch, at) => {
        const block = this.column && blockOf(stretch, this.column, context.timeline);
        if (block) this.inner.take(block, at);
      },
    });
    this.showNode(node);
  }

  get root(): HTMLElement {
    return this.inner.root;
  }

  get panels(): ReadonlyMap<string, ChannelPanel> {
    return this.inner.panels;
  }

  showNode(node: NodeItem): void {
    if (node.layout) this.frames.useLayout(node.layout);
  }

  takeFrame(data: Uint8Array, received: number, at: number): void {
    this.frames.takeFrame(data, received, at);
  }

  takeContacts(): void {
    // A chart shows none.
  }

  takeSkipped(): void {
    this.inner.refill();
  }

  apply(view: View): void {
    this.inner.apply(view);
  }

  refill(): void {
    this.inner.refill();
  }

  frame(at: number): void {
    this.inner.frame(at);
  }

  take(block: LiveBlock, at: number): void {
    this.inner.take(block, at);
  }

  takeEvent(event: EventItem): void {
    this.inner.takeEvent(event);
  }

  repaint(): void {
    this.inner.repaint();
  }

  range(): Range | null {
    return this.inner.range();
  }

  extent(): Range | null {
    return this.inner.extent();
  }

  destroy(): void {
    this.frames.destroy();
    this.inner.destroy();
  }
}
