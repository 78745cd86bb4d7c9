import { readFrames } from "../frames/frame";
import type { Range } from "../state/window";
import type { Timeline } from "../time/timeline";
import { stretchOf, Stretches } from "./stretches";

/** So many pictures are asked for at once. */
export const PICTURES = 60;
/** So many reels are kept: at 8,400 taxels each has 8 MB. */
const MOST_REELS = 10;
/** Of what was loaded while the store was still growing, so long (ms) until it is asked for again; and after a failure. */
const RETRY_MS = 2_000;

/** Pictures of a stretch of the past, each the hull of all samples in it. */
export interface Reel {
  readonly key: string;
  readonly range: Range;
  /** How long each picture is, in ns. */
  readonly step: number;
  readonly stretches: Stretches;
  /** From when on it is worth asking again, in ms of the page's clock. */
  readonly staleAt: number;
}

/** Pictures that are needed: around an instant, each no longer than a step (ns). */
export interface Wanted {
  readonly x: number;
  readonly step: number;
}

export interface FilmOptions {
  readonly timeline: Timeline;
  /** Asks the store for at most so many pictures of a stretch of time, as a CBOR sequence of frames. */
  readonly ask: (range: Range, points: number, signal: AbortSignal) => Promise<Uint8Array>;
  readonly onLoaded: () => void;
  readonly onFailure: (error: unknown) => void;
  /** The page's clock in ms. */
  readonly now: () => number;
  /** Up to here the store may have data, in ns of the timeline. */
  readonly present: () => number;
}

/** The past of a skin as pictures: the store is asked for those around the position, as fine as they can be seen. */
export class Film {
  private reels: Reel[] = [];
  private readonly loading = new Map<string, AbortController>();
  private failedAt = -Infinity;

  constructor(private readonly options: FilmOptions) {}

  /** Whether pictures are being loaded. */
  get busy(): boolean {
    return this.loading.size > 0;
  }

  /** Asks for what is needed, unless it is there or under way; what is no longer needed gives way. */
  want(all: readonly Wanted[]): void {
    const wanted = new Map(all.map((one) => [keyOf(one), one]));
    for (const [key, request] of this.loading) if (!wanted.has(key)) request.abort();
    const now = this.options.now();
    if (now - this.failedAt < RETRY_MS) return;
    for (const [key, one] of wanted) {
      const held = this.reels.find((reel) => reel.key === key);
      if (this.loading.has(key) || (held && now < held.staleAt)) continue;
      void this.load(key, rangeOf(one), fineStep(one.step));
    }
  }

  /** The finest pictures of an instant, or null where none are there yet. */
  at(x: number): Reel | null {
    let found: Reel | null = null;
    for (const reel of this.reels) {
      if (x >= reel.range.x0 && x < reel.range.x1 && (found === null || reel.step < found.step)) found = reel;
    }
    return found;
  }

  /** Forgets everything: another quantity is shown. */
  clear(): void {
    for (const request of this.loading.values()) request.abort();
    this.reels = [];
    this.failedAt = -Infinity;
  }

  private async load(key: string, range: Range, step: number): Promise<void> {
    const request = new AbortController();
    this.loading.set(key, request);
    const { ask, timeline, now, present, onLoaded, onFailure } = this.options;
    try {
      const over = range.x1 < present();
      const data = await ask(range, PICTURES, request.signal);
      if (request.signal.aborted) return;
      const stretches = new Stretches(Infinity);
      for (const frame of readFrames(data)) stretches.put(stretchOf(frame, timeline));
      const reel = { key, range, step, stretches, staleAt: over ? Infinity : now() + RETRY_MS };
      this.reels = [...this.reels.filter((other) => other.key !== key), reel].slice(-MOST_REELS);
      onLoaded();
    } catch (error) {
      if (request.signal.aborted) return;
      this.failedAt = now();
      onFailure(error);
    } finally {
      if (this.loading.get(key) === request) this.loading.delete(key);
    }
  }
}

/** Steps are powers of two: reels of one speed join, and what a zoom needs is often there already. */
function fineStep(step: number): number {
  return 2 ** Math.ceil(Math.log2(Math.max(step, 1e6)));
}

function rangeOf({ x, step }: Wanted): Range {
  const length = fineStep(step) * PICTURES;
  const x0 = Math.floor(x / length) * length;
  return { x0, x1: x0 + length };
}

function keyOf(wanted: Wanted): string {
  return `${fineStep(wanted.step)}/${rangeOf(wanted).x0}`;
}
