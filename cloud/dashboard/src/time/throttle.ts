/**
 * Allows an action once a period. Throttles of one period allow it in the same frame, so that a page which writes its
 * texts then is laid out once for all of them.
 */
export class Throttle {
  private last = Number.NaN;

  constructor(private readonly period: number) {}

  /** Whether a new period has begun since the last call. */
  due(at: number): boolean {
    const period = Math.floor(at / this.period);
    if (period === this.last) return false;
    this.last = period;
    return true;
  }

  /** Makes the next call return true. */
  reset(): void {
    this.last = Number.NaN;
  }
}

/** How often texts are written, in ms: faster changes cannot be read. */
export const TEXT_MS = 200;
