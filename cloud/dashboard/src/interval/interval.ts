import type { IntervalDocument } from "../api/schema";

/** An interval that encloses a truth. An unbounded side is an infinity; NaN on both sides means missing. */
export interface Interval {
  readonly lo: number;
  readonly hi: number;
}

/** Reads the cloud's JSON form, in which null is an unbounded side. */
export function readInterval(json: IntervalDocument): Interval {
  return { lo: json.lo ?? -Infinity, hi: json.hi ?? Infinity };
}

/** Whether the value is missing, which differs from unbounded. */
export function isMissing(interval: Interval): boolean {
  return Number.isNaN(interval.lo) || Number.isNaN(interval.hi);
}
