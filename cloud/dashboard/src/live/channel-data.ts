import type { Client } from "../api/client";
import type { ChannelItem, EventItem, SeriesAnswer } from "../api/contract";
import { type PeakMark, readPeak } from "../chart/peaks";
import type { ChannelFacts } from "../chart/reading";
import type { Stretch } from "../chart/segments";
import type { Interval } from "../interval/interval";
import type { Range } from "../state/window";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { readSeries } from "../tube/decode";
import { clipEnd, copyOf, endOf, type Entries, hullWithin, leastSpacing, NOTHING, worstError } from "../tube/entries";
import { thin } from "../tube/join";
import { Tube } from "../tube/tube";
import type { LiveEdge } from "./edge";

const CAPACITY = 16_384;
/** More than the page loads for a window, so that the stream's do not push out any of those. */
const MOST_MARKS = 4_000;
/** A silence so many times longer than a pause of the channel is taken for a hole. */
const PAUSE_SLACK = 1.5;
/** A stretch of which this share is silent holds no burst. */
const QUIET_SHARE = 0.9;
/** An error of time of this share of a window makes its picture rough, if it is asked for around it in vain. */
const ROUGH_SHARE = 0.25;
/** The store gives the end of a biometric channel as the whole minute after it. */
const MINUTE = 60e9;
/** A node without data for so long is silent. */
const STALE_MS = 4_000;
/** So many pauses in a row whose lengths differ by no more than this share are those between bursts. */
const BURST_PAUSES = 3;
const BURST_JITTER = 0.1;

export interface ChannelDataOptions {
  readonly client: Client;
  readonly timeline: Timeline;
  readonly node: string;
  readonly channel: ChannelItem;
  readonly edge: LiveEdge;
}

function apart(mark: Stretch, range: Range): boolean {
  return mark.x1 < range.x0 || mark.x0 > range.x1;
}

function bounded<Item>(kept: Map<string, Item>): void {
  for (const key of kept.keys()) {
    if (kept.size <= MOST_MARKS) return;
    kept.delete(key);
  }
}

function widened({ x0, x1 }: Range, by: number): Range {
  return { x0: x0 - by, x1: x1 + by };
}

/** One entry for a range of which nothing is known. */
function nothingIn({ x0, x1 }: Range): Entries {
  const [missing, none] = [Float64Array.of(Number.NaN), Float64Array.of(0)];
  return { t: Float64Array.of(x0), width: Float64Array.of(x1 - x0), lo: missing, hi: missing, doubt: none, error: none, reach: none };
}

/** A range that is being loaded, and the stream's samples of it meanwhile. */
interface Filling {
  readonly range: Range;
  readonly runs: Entries[];
}

/** What the page knows of one channel: the rolling window, a stretch of history, peaks and gaps. */
export class ChannelData {
  readonly facts: { -readonly [Key in keyof ChannelFacts]: ChannelFacts[Key] };
  resolution: "sample" | "hull" = "hull";
  history: Entries = NOTHING;
  private readonly tube = new Tube(CAPACITY);
  private readonly peakMarks = new Map<string, PeakMark>();
  private readonly gapMarks = new Map<string, Stretch>();

  /** The stretch of which history has every sample. */
  private loaded: Range | null = null;
  private latest: ChannelItem;
  /** Up to here the store is complete; the live stream brings every sample after it. */
  private storeEnd: number | null;
  /** By how much, at most, `storeEnd` is later than the end of the data, in ns. */
  private endError: number;
  private readonly fillings = new Set<Filling>();
  /** The longest run of the stream, in ns. */
  private longest = 0;
  /** The time error of recent and loaded data, in ns. */
  private error = 0;
  /** The latest silences between runs. */
  private readonly pauses: number[] = [];
  /** Of a channel that measures in bursts, the shortest silence in which the store has nothing either. */
  private pause = Infinity;

  constructor(private readonly options: ChannelDataOptions) {
    const { channel } = options;
    this.latest = channel;
    this.storeEnd = this.storedEnd();
    this.endError = channel.biometric && this.storeEnd !== null ? MINUTE : 0;
    this.facts = { unit: channel.unit, bursts: false };
  }

  /** The channel as last listed by the store. */
  get channel(): ChannelItem {
    return this.latest;
  }

  set channel(channel: ChannelItem) {
    this.latest = channel;
  }

  /** The end of the data from store and stream. */
  get end(): number | null {
    return this.storeEnd;
  }

  /** The last stretch of the data, of so many ns; longer where their end is known to the minute only. */
  tail(span: number): Range | null {
    const { storeEnd } = this;
    return storeEnd === null ? null : { x0: storeEnd - this.endError - span, x1: storeEnd };
  }

  /** The hull of what is held, or null where nothing is. */
  get bounds(): Interval | null {
    for (const entries of [this.rolling, this.history]) {
      const { lo, hi, count } = hullWithin(entries, -Infinity, Infinity);
      if (count > 0) return { lo, hi };
    }
    return null;
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

  /** Where its data end, if more should have come by now: from the node, or from this channel of it; else null. */
  silentSince(at: number): number | null {
    const { edge } = this.options;
    const newest = edge.newest();
    if (newest === null) return null;
    const end = Math.min(newest, this.storeEnd ?? newest);
    const patience = Math.max(STALE_MS, 4 * edge.rhythm());
    const usual = Math.max(this.longest + 3 * (this.latest.dt ?? 0), this.usualPause);
    const silent = edge.silence(at) > patience || newest - end > edge.timeIn(patience) + usual;
    return silent ? end : null;
  }

  /** The first and last instant that the channel has data of, or null for an empty channel. */
  get extent(): Range | null {
    const { timeline } = this.options;
    const stored = this.storedEnd();
    if (this.latest.first === null || stored === null) return null;
    let end = Math.max(stored, this.storeEnd ?? stored);
    if (this.latest.biometric) {
      const exact = this.endError === 0 ? this.storeEnd : null;
      end = exact ?? Math.min(stored, Math.max(stored - MINUTE, timeline.now()));
    }
    return { x0: timeline.toX(parseInstant(this.latest.first)), x1: end };
  }

  /**
   * Takes samples of the live stream; returns the range before them that is still missing.
   *
   * @param grain the finest that can be seen, in ns; null for a hidden chart: the samples are
   * dropped and loaded later
   */
  take(run: Entries, at: number, grain: number | null): { taken: Range | null; hole: Range | null } {
    const end = endOf(run);
    if (end === null) return { taken: null, hole: null };
    const start = run.t[0]!;
    const spacing = leastSpacing(run);
    const before = (this.storeEnd ?? start) - this.endError;
    this.endError = 0;
    const silence = start - before;
    // What comes late lies in the middle of what was loaded.
    if (this.loaded && !apart(this.loaded, { x0: start, x1: end })) this.loaded = null;
    this.storeEnd = Math.max(before, end + spacing);
    this.longest = Math.max(this.longest, end - start);
    this.error = Math.max(this.error, worstError(run));
    this.options.edge.observe(end, at);
    const pauses = silence > 3 * spacing;
    if (pauses) this.notePause(silence);
    if (grain === null) return { taken: null, hole: null };
    const seen = thin(run, grain);
    this.tube.merge(seen);
    for (const { range, runs } of this.fillings) if (!apart(range, { x0: start, x1: end })) runs.push(seen);
    const hole = pauses && silence > this.usualPause;
    return { taken: { x0: start, x1: end }, hole: hole ? { x0: before, x1: start } : null };
  }

  /** A channel measures in bursts while its latest pauses are about equally long. */
  private notePause(silence: number): void {
    const { pauses } = this;
    pauses.push(silence);
    if (pauses.length > BURST_PAUSES) pauses.shift();
    const [shortest, longest] = [Math.min(...pauses), Math.max(...pauses)];
    this.facts.bursts = pauses.length === BURST_PAUSES && longest - shortest <= BURST_JITTER * longest;
  }

  /** Fills a stretch of the rolling window, up to `end` at most, from the store. */
  async backfill(range: Range, points: number, signal: AbortSignal): Promise<void> {
    const filling: Filling = { range, runs: [] };
    const vague = range.x1 === this.storeEnd ? this.endError : 0;
    this.fillings.add(filling);
    try {
      const answer = await this.ask(range, points, signal);
      this.fill(range, readSeries(answer, this.options.timeline), vague);
      // The stream's samples may have been stored after the store was read.
      for (const run of filling.runs) this.tube.merge(run);
    } finally {
      this.fillings.delete(filling);
    }
  }

  /** @param vague by how much, at most, the range ends after the data, in ns */
  private fill(range: Range, run: Entries, vague: number): void {
    const { dt } = this.latest;
    const known = run.lo.findLastIndex((lo) => !Number.isNaN(lo));
    const end = known < 0 ? range.x0 : run.t[known]! + Math.max(run.width[known]!, dt ?? 1);
    const x1 = Math.min(range.x1, Math.max(end, range.x1 - vague));
    if (vague > 0 && this.endError > 0) {
      this.storeEnd = x1;
      this.endError = 0;
    }
    // Behind that, the live stream knows more than this answer.
    this.tube.replace({ x0: Math.floor(range.x0), x1 }, clipEnd(run, x1));
    const silent = { x0: end, x1: Math.min(x1, this.storeEnd ?? x1) };
    const quiet = silent.x1 - silent.x0;
    const usual = dt === null ? (run.reach[known] ?? 0) : 2 * dt;
    if (quiet > usual) this.tube.replace(silent, nothingIn(silent));
    if (this.facts.bursts && quiet > QUIET_SHARE * (range.x1 - range.x0)) this.pause = Math.min(this.pause, quiet);
  }

  /**
   * Loads a stretch of history, and around it whatever may lie in it, too: the times of samples may be wrong by
   * as much as the answer says.
   */
  async load(range: Range, points: number, signal: AbortSignal): Promise<void> {
    // The stream may raise it meanwhile.
    const { error } = this;
    let wide = widened(range, error);
    let answer = await this.ask(wide, points, signal);
    // What was so wrong lately need not be here; then the window is a small part of what was asked for.
    const rough = answer.resolution === "hull" && answer.time_error < error && ROUGH_SHARE * (range.x1 - range.x0) < error;
    if (answer.time_error > error || rough) {
      wide = widened(range, answer.time_error);
      answer = await this.ask(wide, points, signal);
    }
    this.error = answer.time_error;
    this.resolution = answer.resolution;
    this.history = readSeries(answer, this.options.timeline);
    this.loaded = answer.resolution === "sample" ? wide : null;
  }

  /** Whether history has every sample of a window that is over: then there is nothing to ask for. */
  holds(range: Range): boolean {
    const { loaded, storeEnd } = this;
    const { x0, x1 } = widened(range, this.error);
    return loaded !== null && x0 >= loaded.x0 && x1 <= loaded.x1 && storeEnd !== null && x1 < storeEnd;
  }

  /** Starts history with what the rolling window shows, until the store has answered. */
  freeze(): void {
    this.history = copyOf(this.rolling);
    this.loaded = null;
  }

  /** Forgets the rolling window. */
  clear(): void {
    this.tube.clear();
  }

  /** Forgets the values and marks that are over before an instant. */
  evictBefore(x: number): void {
    this.tube.evictBefore(x);
    for (const marks of [this.peakMarks, this.gapMarks]) {
      for (const [id, mark] of marks) if (mark.x1 < x) marks.delete(id);
    }
  }

  /**
   * Takes a peak or a gap.
   *
   * @param within the window of history that is shown, which the stream's marks must not crowd out; null for a live one
   */
  takeEvent(event: EventItem, within: Range | null): void {
    const { timeline } = this.options;
    const peak = readPeak(event, timeline);
    if (peak) {
      if (within && apart(peak, within)) return;
      this.peakMarks.delete(event.id);
      this.peakMarks.set(event.id, peak);
      bounded(this.peakMarks);
    } else if (event.kind === "gap") {
      const gap = { x0: timeline.toX(parseInstant(event.time.lo)), x1: timeline.toX(parseInstant(event.time.hi)) };
      if (within && apart(gap, within)) return;
      this.gapMarks.set(event.id, gap);
      bounded(this.gapMarks);
    }
  }

  /** The longest silence that is none; 0 of a channel that measures all the time. */
  private get usualPause(): number {
    return this.pause === Infinity ? 0 : PAUSE_SLACK * this.pause;
  }

  private storedEnd(): number | null {
    const { last, dt } = this.latest;
    return last === null ? null : this.options.timeline.toX(parseInstant(last)) + (dt ?? 0);
  }

  private ask(range: Range, points: number, signal: AbortSignal): Promise<SeriesAnswer> {
    const { client, timeline, node } = this.options;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)), points };
    return client.series({ node, channel: this.latest.id }, window, signal);
  }
}
