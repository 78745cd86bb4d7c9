/** An interval that encloses a truth. An unbounded side is an infinity; NaN on both sides means missing. */
export interface Interval {
  readonly lo: number;
  readonly hi: number;
}

/** The cloud's JSON form: null is an unbounded side. */
export interface IntervalJson {
  readonly lo: number | null;
  readonly hi: number | null;
}

/** Reads the JSON form, in which a null side is unbounded. */
export function readInterval(json: IntervalJson): Interval {
  return { lo: json.lo ?? -Infinity, hi: json.hi ?? Infinity };
}

/** Tells whether nothing is known: the value is missing, which differs from unbounded. */
export function isMissing(interval: Interval): boolean {
  return Number.isNaN(interval.lo) || Number.isNaN(interval.hi);
}
