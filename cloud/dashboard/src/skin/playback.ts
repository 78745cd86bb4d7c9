/** The position stops this many ns before the end: the last sample holds until there. */
const LAST = 1;
/** So many stretches may be waiting; if more are (frames were left out, a tab was asleep), all but the last are skipped. */
const MOST_STRETCHES = 3;

/**
 * Plays the samples of stretches at their own period. A stretch begins to play as soon as it is there, so what is
 * shown is as old as a stretch is long, and the time that it took to arrive. When stretches come unevenly, it plays
 * faster until no more than one of them is waiting. It needs no common clock with the node, nor one of its pace.
 */
export class Playback {
  /** In ns of the timeline; null before the first data. */
  position: number | null = null;
  private at = 0;

  /**
   * Moves on, and gives the position in ns of the timeline; null before the first data.
   *
   * @param at the page's clock in ms
   * @param end up to where data is there, in ns
   * @param stretch how long a stretch is, in ns
   */
  move(at: number, end: number | null, stretch: number): number | null {
    const passed = Math.max(0, at - this.at) * 1e6;
    this.at = at;
    if (end === null) return this.position;
    const start = end - stretch;
    const waiting = end - (this.position ?? -Infinity);
    if (waiting > MOST_STRETCHES * stretch || waiting < -stretch) this.position = start;
    else if (waiting > LAST) {
      const pace = Math.max(1, waiting / stretch);
      this.position = Math.min(this.position! + pace * passed, end - LAST);
    }
    return this.position;
  }

  stop(): void {
    this.position = null;
  }
}
