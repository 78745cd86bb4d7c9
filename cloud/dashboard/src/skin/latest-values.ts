import type { LiveBlock, SeriesAnswer } from "../api/contract";
import { type Interval, readInterval } from "../interval/interval";
import type { LiveEdge } from "../live/edge";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";

/** What is older is not the present, nor what nothing followed for so long. */
const STALE_MS = 4_000;
const MS = 1e6;
/** Of two clocks neither gains more on the other than this share of the time. */
const DRIFT = 1e-3;
/** Clocks of clouds that share a store differ by less (ns). */
const SLACK = 1e9;

interface Latest {
  /** Null where the block has no known sample. */
  readonly interval: Interval | null;
  /** The time of the block's last entry. */
  readonly end: number;
  /** By when its last sample, and those of earlier blocks, were taken. */
  readonly stop: number;
  /** The time of the last one of which something is known; as the block's last where none is. */
  readonly known: number;
  /** How far these times may be wrong. */
  readonly error: number;
  /** When the block came, in ms of the page's clock. */
  readonly at: number;
}

/** Joins a block's intervals to their hull; a missing sample makes nothing of it, an unbounded side counts. */
export function hullOf({ lo, hi }: Pick<SeriesAnswer, "lo" | "hi">): Interval | null {
  let hull: Interval | null = null;
  for (const [index, low] of lo.entries()) {
    const high = hi[index] ?? null;
    if (low === null && high === null) continue;
    const one = readInterval({ lo: low, hi: high });
    hull = hull === null ? one : { lo: Math.min(hull.lo, one.lo), hi: Math.max(hull.hi, one.hi) };
  }
  return hull;
}

/**
 * The latest value of each channel of one node. A block that arrives late holds old values: it changes nothing, and
 * the current value is unknown until a newer block arrives.
 */
export class LatestValues {
  private readonly channels = new Map<string, Latest>();
  /** Of all blocks, that with the newest samples. */
  private newest: Latest | null = null;
  /**
   * What at least is added to the page's clock (ns) to give the cloud's: no block came before it was stored. And by
   * which time of the page's clock (ms).
   */
  private clock: { readonly offset: number; readonly at: number } | null = null;
  /** When the latest block of each channel was stored, by the cloud's clock. */
  private readonly stored = new Map<string, number>();

  constructor(private readonly timeline: Timeline, private readonly edge: LiveEdge) {}

  /** Takes a live block that arrived at a time of the page's clock (ms). */
  take(block: LiveBlock, at: number): void {
    const begin = this.timeline.toX(parseInstant(block.t0));
    const end = begin + (block.t.at(-1) ?? 0);
    const held = this.channels.get(block.channel);
    this.setClock(block, at, !held || end >= held.stop);
    if (held && end <= held.end) return;
    const last = block.t.findLastIndex((_, i) => (block.lo[i] ?? block.hi[i] ?? null) !== null);
    const known = last < 0 ? end : begin + block.t[last]!;
    const stop = Math.max(held?.stop ?? end, end + (block.resolution === "hull" ? block.dt : 0));
    const latest = { interval: hullOf(block), end, stop, known, error: block.time_error, at };
    this.channels.set(block.channel, latest);
    if (this.newest === null || end > this.newest.end) this.newest = latest;
  }

  /** How old the newest samples were at least (ns) when they came, if that was too old: the node brings what waited. */
  get age(): number | null {
    const age = this.newest === null ? 0 : this.ageOf(this.newest, this.newest.stop + this.newest.error);
    return age > STALE_MS * MS ? age : null;
  }

  /** The interval of a channel at a time of the page's clock (ms); null where it is unknown. */
  of(channel: string, at: number): Interval | null {
    const latest = this.channels.get(channel);
    if (!latest || at - latest.at >= STALE_MS) return null;
    const known = latest.known - latest.error;
    if (this.ageOf(latest, known) > STALE_MS * MS) return null;
    // A simulated node's clock may run faster than ours: then as much more of its time passes.
    const behind = Math.max(this.edge.newest() ?? latest.end, latest.end) - known;
    return behind > this.edge.timeIn(STALE_MS) ? null : latest.interval;
  }

  /** How old one of its samples was at least when it came, in ns by the cloud's clock. */
  private ageOf({ at }: Latest, taken: number): number {
    return at * MS + (this.clock?.offset ?? -Infinity) - taken;
  }

  /**
   * Blocks stored long ago may arrive together: each proves only that the cloud's clock is not behind it.
   *
   * @param isNext whether the block repeats no earlier one, as a resumed stream may
   */
  private setClock(block: LiveBlock, at: number, isNext: boolean): void {
    const stored = this.timeline.toX(parseInstant(block.stored));
    const offset = stored - at * MS;
    // A channel's blocks come in the order in which they were stored.
    const wasSetBack = isNext && stored < (this.stored.get(block.channel) ?? -Infinity) - SLACK;
    if (isNext) this.stored.set(block.channel, stored);
    const { clock } = this;
    const known = clock === null || wasSetBack ? offset : Math.max(offset, clock.offset - DRIFT * (at - clock.at) * MS);
    this.clock = { offset: known, at };
  }

  clear(): void {
    this.channels.clear();
    this.newest = null;
  }
}
