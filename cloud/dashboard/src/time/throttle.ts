/**
 * Tells once in every so many ms that it is time. Beats of one period fall into the same frames wherever they are
 * asked, so that a page which writes its texts at them is laid out once for all of these.
 */
export class Throttle {
  private last = Number.NaN;

  constructor(private readonly period: number) {}

  /** Whether a beat has passed since it was last asked. */
  due(at: number): boolean {
    const beat = Math.floor(at / this.period);
    if (beat === this.last) return false;
    this.last = beat;
    return true;
  }

  /** Has the next question answered with yes. */
  reset(): void {
    this.last = Number.NaN;
  }
}

/** How often texts are written, in ms: faster than this nobody reads. */
export const TEXT_MS = 200;
