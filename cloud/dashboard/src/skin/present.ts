import type { LiveBlock, SeriesAnswer } from "../api/contract";
import { readInterval, type Interval } from "../interval/interval";
import type { LiveEdge } from "../live/edge";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";

/** What is older is not the present, nor what nothing followed for so long. */
const STALE_MS = 4_000;
const MS = 1e6;
/** The cloud's clock is told by so many of the latest blocks. */
const CLOCKS = 64;

interface Told {
  /** Null where the block has no known sample. */
  readonly interval: Interval | null;
  /** When the block's last sample was taken. */
  readonly end: number;
  /** When the last one of which something is known was taken; as the block's last where none is. */
  readonly known: number;
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
 * What the channels of one node measure at present. A block that comes late tells of the past: it changes nothing,
 * and where nothing newer is known, nothing is known of the present.
 */
export class Present {
  private readonly latest = new Map<string, Told>();
  /** Of all blocks, that with the newest samples. */
  private newest: Told | null = null;
  /** By the latest blocks, what is added to the page's clock (ns) to give the cloud's: none came before it was stored. */
  private readonly offsets: number[] = [];

  constructor(private readonly timeline: Timeline, private readonly edge: LiveEdge) {}

  /** Takes a live block, that came at a moment of the page's clock (ms). */
  take(block: LiveBlock, at: number): void {
    this.offsets.push(this.timeline.toX(parseInstant(block.stored)) - at * MS);
    if (this.offsets.length > CLOCKS) this.offsets.shift();
    const begin = this.timeline.toX(parseInstant(block.t0));
    const end = begin + (block.t.at(-1) ?? 0);
    const held = this.latest.get(block.channel);
    if (held && end <= held.end) return;
    const last = block.t.findLastIndex((_, i) => (block.lo[i] ?? block.hi[i] ?? null) !== null);
    const told = { interval: hullOf(block), end, known: last < 0 ? end : begin + block.t[last]!, at };
    this.latest.set(block.channel, told);
    if (this.newest === null || end > this.newest.end) this.newest = told;
  }

  /** How old the newest samples were at least (ns) when they came, if that was too old: the node brings what waited. */
  get age(): number | null {
    const age = this.newest === null ? 0 : this.ageOf(this.newest, this.newest.end);
    return age > STALE_MS * MS ? age : null;
  }

  /** The interval of a channel at a moment of the page's clock (ms); null where nothing is known of the present. */
  of(channel: string, at: number): Interval | null {
    const told = this.latest.get(channel);
    if (!told || at - told.at >= STALE_MS) return null;
    if (this.ageOf(told, told.known) > STALE_MS * MS) return null;
    // A simulated node's clock may run faster than ours: then as much more of its time passes.
    const behind = Math.max(this.edge.newest() ?? told.end, told.end) - told.known;
    return behind > this.edge.timeIn(STALE_MS) ? null : told.interval;
  }

  /** How old one of its samples was at least when it came, in ns by the cloud's clock. */
  private ageOf({ at }: Told, taken: number): number {
    return at * MS + Math.max(...this.offsets) - taken;
  }

  clear(): void {
    this.latest.clear();
    this.newest = null;
    this.offsets.length = 0;
  }
}
