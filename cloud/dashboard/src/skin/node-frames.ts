import type { ContactsItem, LayoutItem } from "../api/contract";
import type { Client } from "../api/client";
import { isAbort, messageOf } from "../api/error";
import { readFrame } from "../frames/frame";
import { CloudClock } from "../live/cloud-clock";
import { hex } from "../live/frame-feed";
import type { Timeline } from "../time/timeline";
import { ContactTrack, contactsAt, type ContactsAt } from "./contacts";
import { stretchOf, Stretches, type Stretch } from "./stretches";

/** So many stretches of each page are kept: the oldest is a few seconds old. */
const MOST_STRETCHES = 24;
const MOST_CONTACTS = 3_000;
const RETRY_MS = 3_000;
/** What was measured longer ago (ns) when it came is not the present. */
const OLD_NS = 4e9;

export interface NodeFramesOptions {
  readonly client: Client;
  readonly timeline: Timeline;
  readonly node: string;
  /** The layout is known, or is another one now. */
  readonly onLayout: (layout: LayoutItem) => void;
  readonly onFailure: (message: string) => void;
  /** A new stretch was decoded; `at` is when it came, in ms of the page's clock. */
  readonly onStretch: (stretch: Stretch, at: number) => void;
}

/** The layout of a node, and the newest of its frames and contacts. */
export class NodeFrames {
  layout: LayoutItem | null = null;
  readonly stretches = new Stretches(MOST_STRETCHES);
  readonly contacts = new ContactTrack(MOST_CONTACTS);
  /** When the newest frame came, in ms of the page's clock; one that holds older samples does not count. */
  arrivedAt = -Infinity;
  /** How long after the newest stretch had ended it came at least, in ns, by the clocks of node and cloud. */
  late = 0;
  /** From sample to sample of what is sampled most often, in ns; null before the first frame. */
  period: number | null = null;
  private readonly clock = new CloudClock();
  private hash: string | null = null;
  private loading = new AbortController();
  private timer: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly options: NodeFramesOptions) {}

  /** Whether the newest frame held what was over when it came: a node that was cut off sends what waited. */
  get isPast(): boolean {
    return this.late > OLD_NS;
  }

  /** Reads frames by this layout from now on; it is loaded unless it is there. */
  useLayout(hash: string): void {
    if (hash === this.hash) return;
    this.hash = hash;
    void this.load(hash);
  }

  /** Takes a frame as it came over the wire, unless it was made by another layout: then that one is loaded. */
  takeFrame(data: Uint8Array, received: number, at: number): void {
    const { timeline, onStretch } = this.options;
    const frame = readFrame(data);
    const hash = hex(frame.layout);
    if (hash !== this.hash) this.useLayout(hash);
    if (hash !== this.layout?.layout) return;
    const stretch = stretchOf(frame, timeline);
    this.clock.observe(Number(BigInt(received) - timeline.origin), at);
    if (stretch.end >= (this.stretches.end ?? -Infinity)) {
      this.arrivedAt = at;
      this.late = this.clock.ageOf(stretch.end + stretch.error, at);
    }
    this.stretches.put(stretch);
    this.period = Math.min(...frame.patches.map(({ grid }) => grid.period));
    onStretch(stretch, at);
  }

  takeContacts(json: string): ContactsAt {
    const found = contactsAt(JSON.parse(json) as ContactsItem, this.options.timeline);
    this.contacts.put(found);
    return found;
  }

  destroy(): void {
    this.loading.abort();
    if (this.timer !== null) clearTimeout(this.timer);
  }

  private async load(hash: string): Promise<void> {
    this.loading.abort();
    this.loading = new AbortController();
    const { signal } = this.loading;
    const { client, node, onLayout, onFailure } = this.options;
    let layout: LayoutItem;
    try {
      layout = await client.layout(node, hash, signal);
    } catch (error) {
      if (isAbort(error)) return;
      onFailure(messageOf(error));
      this.timer = setTimeout(() => void this.load(hash), RETRY_MS);
      return;
    }
    if (this.hash !== hash) return;
    this.layout = layout;
    this.stretches.clear();
    onLayout(layout);
  }
}
