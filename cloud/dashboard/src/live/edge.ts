const SETTLE_MS = 500;
const KEPT = 64;
const SLOWEST = 1e4;
const FASTEST = 1e9;
/** Data so many times further ahead than the pace explains is a node's return, not its pace. */
const LEAP = 20;

/**
 * The moving right edge of the live windows of one node. Frames come in jumps; the edge moves smoothly
 * ahead of them, at the pace of the node's own clock (which may run faster than ours in a simulation), so
 * that a frame is painted as soon as it is there: what is still under way is an empty strip at the edge.
 */
export class LiveEdge {
  private readonly seen: { at: number; end: number }[] = [];
  private shown: number | null = null;
  private shownAt = 0;

  /** Takes note that data up to `end` (ns) was there at `at` (ms of the page's clock). */
  observe(end: number, at: number): void {
    const last = this.seen.at(-1);
    if (last && end <= last.end) return;
    if (last && at - last.at < 20) {
      last.end = end;
      return;
    }
    if (last && end - last.end > LEAP * this.pace() * (at - last.at) + 5e9) this.seen.length = 0;
    this.seen.push({ at, end });
    if (this.seen.length > KEPT) this.seen.shift();
  }

  /** Where the newest data ends, or null before the first. */
  newest(): number | null {
    return this.seen.at(-1)?.end ?? null;
  }

  /** Milliseconds since data last arrived. */
  silence(at: number): number {
    const last = this.seen.at(-1);
    return last ? at - last.at : 0;
  }

  /** The typical time between two arrivals in ms. */
  rhythm(): number {
    const first = this.seen[0];
    const last = this.seen.at(-1);
    if (!first || !last || this.seen.length < 2) return 0;
    return (last.at - first.at) / (this.seen.length - 1);
  }

  /**
   * The edge to show at a time.
   *
   * @param at the page's clock in ms
   * @param span the width of the window in ns: the edge stops when half of it would be empty
   */
  at(at: number, span: number): number | null {
    const last = this.seen.at(-1);
    if (!last) return null;
    const pace = this.pace();
    const target = Math.min(last.end + pace * Math.max(0, at - last.at), last.end + span / 2);
    const passed = at - this.shownAt;
    const jump = this.shown === null || Math.abs(target - this.shown) > Math.max(span / 2, 3e9) || passed > 2000;
    if (jump || this.shown === null) this.shown = target;
    else {
      const moved = this.shown + pace * passed;
      this.shown = Math.min(moved + (target - moved) * (1 - Math.exp(-passed / SETTLE_MS)), last.end + span / 2);
    }
    this.shownAt = at;
    return this.shown;
  }

  /** How much of the node's time (ns) passes in so many ms of the page's clock, and no less than in ours. */
  timeIn(ms: number): number {
    return Math.max(1e6, this.pace()) * ms;
  }

  /** Nanoseconds of data for each millisecond of the page's clock. */
  private pace(): number {
    const first = this.seen[0];
    const last = this.seen.at(-1);
    if (!first || !last || last.at - first.at < 800) return 1e6;
    return Math.min(FASTEST, Math.max(SLOWEST, (last.end - first.end) / (last.at - first.at)));
  }
}
