import type { EventItem, LiveBlock, NodeItem } from "../api/contract";
import type { View } from "../state/route";
import type { Range } from "../state/window";
import type { ChannelPanel } from "./channel-panel";

/** The part of a page that shows one node. */
export interface Section {
  readonly root: HTMLElement;
  readonly panels: ReadonlyMap<string, ChannelPanel>;
  apply(view: View): void;
  /** Asks for what is shown again, after the stream has left something out. */
  refill(): void;
  frame(at: number): void;
  /** Takes a live block that came at a time of the page's clock (ms). */
  take(block: LiveBlock, at: number): void;
  takeEvent(event: EventItem): void;
  repaint(): void;
  /** The window that it shows. */
  range(): Range | null;
  /** From the first to the last sample that is known of. */
  extent(): Range | null;
  destroy(): void;
}

/** The part of a page that shows a node whose channels come as frames. */
export interface FramedSection extends Section {
  /** Takes over how the node is: it may have another layout now. */
  showNode(node: NodeItem): void;
  /** Takes a frame; `received` is when the cloud had it (UTC, ns). */
  takeFrame(data: Uint8Array, received: number, at: number): void;
  /** Takes what the cloud says of contacts. */
  takeContacts(json: string): void;
  /** So many frames of the page's nodes were not sent, because they came too slowly. */
  takeSkipped(frames: number): void;
}
