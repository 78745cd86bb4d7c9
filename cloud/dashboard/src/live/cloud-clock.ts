/** Of two clocks neither gains more on the other than this share of the time. */
const DRIFT = 1e-3;
/** Frames come in the order in which they were received; clocks of clouds that share a store differ by less (ns). */
const SLACK = 1e9;
const MS = 1e6;

/** Computes how old what comes is, by the cloud's clock: no frame comes before the cloud has received it. */
export class CloudClock {
  /** What at least is added to the page's clock (ns) to give the cloud's, and by which time of the page's clock (ms). */
  private known: { readonly offset: number; readonly at: number } | null = null;
  private received = -Infinity;

  /**
   * Takes note that something came.
   *
   * @param received when the cloud received it, in ns
   * @param at the page's clock in ms
   */
  observe(received: number, at: number): void {
    const { known } = this;
    const offset = received - at * MS;
    const wasSetBack = received < this.received - SLACK;
    this.received = received;
    // Frames received long ago may come together: each proves only that the cloud's clock is not behind it.
    const proved = known === null || wasSetBack ? offset : Math.max(offset, known.offset - DRIFT * (at - known.at) * MS);
    this.known = { offset: proved, at };
  }

  /** How old at least what was so at an instant (ns) is at a time of the page's clock (ms), in ns. */
  ageOf(instant: number, at: number): number {
    return at * MS + (this.known?.offset ?? -Infinity) - instant;
  }
}
