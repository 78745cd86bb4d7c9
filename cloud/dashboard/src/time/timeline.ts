import type { Instant } from "./instant";

/**
 * Maps instants to plain numbers near zero: nanoseconds after an origin. Within 104 days of the origin
 * such a number holds every nanosecond exactly, which nanoseconds since 1970 would not.
 */
export class Timeline {
  constructor(readonly origin: Instant) {}

  /** Nanoseconds after the origin. */
  toX(instant: Instant): number {
    return Number(instant - this.origin);
  }

  /** The page's clock. */
  now(): number {
    return this.toX(BigInt(Date.now()) * 1_000_000n);
  }

  /** How far a number at most may lie from the instant that it was read from, in ns: 0 near the origin. */
  slip(x: number): number {
    const bits = Math.floor(Math.log2(Math.max(1, Math.abs(x)))) - 52;
    return bits > 0 ? 2 ** bits : 0;
  }

  /** The instant at x, cut to whole nanoseconds. */
  toInstant(x: number): Instant {
    return this.origin + BigInt(Math.floor(x));
  }
}
