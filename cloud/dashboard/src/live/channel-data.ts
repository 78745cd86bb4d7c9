import type { Client } from "../api/client";
import type { ChannelItem, EventItem, SeriesAnswer } from "../api/contract";
import { readPeak, type PeakMark } from "../chart/peak-groups";
import type { ChannelFacts } from "../chart/reading";
import type { Stretch } from "../chart/segments";
import type { Range } from "../state/window";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { readSeries } from "../tube/decode";
import { endOf, hullWithin, NOTHING, type Entries } from "../tube/entries";
import { Tube } from "../tube/tube";
import type { LiveEdge } from "./edge";

const CAPACITY = 16_384;
const MOST_MARKS = 500;

export interface ChannelDataOptions {
  readonly client: Client;
  readonly timeline: Timeline;
  readonly node: string;
  readonly channel: ChannelItem;
  readonly edge: LiveEdge;
}

function bounded<Item>(kept: Map<string, Item>): void {
  for (const key of kept.keys()) {
    if (kept.size <= MOST_MARKS) return;
    kept.delete(key);
  }
}

/** What the page knows of one channel: the rolling window, a stretch of history, peaks and gaps. */
export class ChannelData {
  readonly facts: { -readonly [Key in keyof ChannelFacts]: ChannelFacts[Key] };
  resolution: "sample" | "hull" = "hull";
  history: Entries = NOTHING;
  private readonly tube = new Tube(CAPACITY);
  private readonly peakMarks = new Map<string, PeakMark>();
  private readonly gapMarks = new Map<string, Stretch>();

  /** What the store last said of the channel. */
  channel: ChannelItem;

  constructor(private readonly options: ChannelDataOptions) {
    const { channel } = options;
    this.channel = channel;
    this.facts = { unit: channel.unit, coverage: channel.coverage, timeError: 0 };
  }

  get rolling(): Entries {
    return this.tube.view();
  }

  get peaks(): PeakMark[] {
    return [...this.peakMarks.values()];
  }

  get gaps(): Stretch[] {
    return [...this.gapMarks.values()];
  }

  /** The first and last instant that the channel has data of, or null for an empty channel. */
  get extent(): Range | null {
    const { timeline } = this.options;
    const { channel } = this;
    if (channel.first === null || channel.last === null) return null;
    const known = timeline.toX(parseInstant(channel.last)) + channel.dt;
    return { x0: timeline.toX(parseInstant(channel.first)), x1: Math.max(known, endOf(this.rolling) ?? known) };
  }

  /** Takes a live block; returns the stretch that is missing before it, if there is one. */
  take(block: SeriesAnswer, at: number): { block: Range | null; hole: Range | null } {
    const run = readSeries(block, this.options.timeline);
    const before = endOf(this.rolling);
    const end = endOf(run);
    if (end === null) return { block: null, hole: null };
    this.note(block);
    this.tube.merge(run);
    this.options.edge.observe(end, at);
    const start = run.t[0]!;
    const hole = before !== null && start - before > Math.max(2 * run.reach, 3 * this.options.channel.dt);
    return { block: { x0: start, x1: end }, hole: hole ? { x0: before, x1: start } : null };
  }

  /** Fills a stretch of the rolling window from the store. */
  async backfill(range: Range, points: number, signal: AbortSignal): Promise<void> {
    const answer = await this.ask(range, points, signal);
    this.note(answer);
    const known = readSeries(answer, this.options.timeline);
    this.tube.merge(known);
  }

  /** Loads a stretch of history. */
  async load(range: Range, points: number, signal: AbortSignal): Promise<void> {
    const answer = await this.ask(range, points, signal);
    this.note(answer);
    this.resolution = answer.resolution;
    this.history = readSeries(answer, this.options.timeline);
  }

  /** Starts history with what the rolling window shows, until the store has answered. */
  freeze(): void {
    const { t, width, lo, hi, reach } = this.rolling;
    this.history = { t: t.slice(), width: width.slice(), lo: lo.slice(), hi: hi.slice(), reach };
  }

  /** Forgets the rolling window. */
  clear(): void {
    this.tube.clear();
  }

  /** Whether any value of a window is known. */
  knows(range: Range): boolean {
    return [this.history, this.rolling].some((run) => hullWithin(run, range.x0, range.x1).count > 0);
  }

  evictBefore(x: number): void {
    this.tube.evictBefore(x);
  }

  takeEvent(event: EventItem): void {
    const { timeline } = this.options;
    const peak = readPeak(event, timeline);
    if (peak) {
      this.peakMarks.delete(event.id);
      this.peakMarks.set(event.id, peak);
      bounded(this.peakMarks);
    } else if (event.kind === "gap") {
      const x0 = timeline.toX(parseInstant(event.time.lo));
      this.gapMarks.set(event.id, { x0, x1: timeline.toX(parseInstant(event.time.hi)) });
      bounded(this.gapMarks);
    }
  }

  private note(answer: SeriesAnswer): void {
    this.facts.coverage = answer.coverage;
    this.facts.timeError = answer.time_error;
  }

  private ask(range: Range, points: number, signal: AbortSignal): Promise<SeriesAnswer> {
    const { client, timeline, node, channel } = this.options;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)), points };
    return client.series({ node, channel: channel.id }, window, signal);
  }
}
