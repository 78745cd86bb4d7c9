import type { EventItem, NodeItem } from "../api/contract";
import type { View } from "../state/route";
import type { Range } from "../state/window";
import type { ChannelPanel } from "./channel-panel";

/** The part of a page that shows one node, or a skin that several nodes share. */
export interface Section {
  readonly root: HTMLElement;
  readonly panels: ReadonlyMap<string, ChannelPanel>;
  /** Whose frames it shows. */
  readonly nodes: readonly string[];
  /** The patches that it needs; null: all. */
  readonly patches: readonly string[] | null;
  /** Takes over how the node is: it may have another layout now. */
  showNode(node: NodeItem): void;
  /** Says why nothing is known of the node. */
  showFailure(message: string): void;
  /** Says that the cloud knows no such node. */
  showAbsence(): void;
  /** Takes a frame; `received` is when the cloud had it (UTC, ns), `at` when the page had it (ms of its clock). */
  takeFrame(data: Uint8Array, received: number, at: number): void;
  /** Takes what the cloud says of contacts. */
  takeContacts(json: string): void;
  /** So many frames of the page's nodes were not sent, because the page was too slow, or away for too long (null: their number is not known). */
  takeSkipped(frames: number | null): void;
  takeEvent(event: EventItem): void;
  apply(view: View): void;
  frame(at: number): void;
  repaint(): void;
  /** The window that it shows. */
  range(): Range | null;
  /** From the first to the last sample that is known of. */
  extent(): Range | null;
  destroy(): void;
}
