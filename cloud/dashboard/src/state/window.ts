/** A stretch of time in nanoseconds after the timeline's origin. */
export interface Range {
  readonly x0: number;
  readonly x1: number;
}

export const SHORTEST = 100;
const LONGEST = 10 * 365 * 86_400e9;

/** Zooms about an anchor (0 at the left edge, 1 at the right one); a factor below 1 zooms in. */
export function zoom(range: Range, anchor: number, factor: number): Range {
  const span = range.x1 - range.x0;
  const next = Math.min(LONGEST, Math.max(SHORTEST, span * factor));
  const fixed = range.x0 + anchor * span;
  return settle({ x0: fixed - anchor * next, x1: fixed + (1 - anchor) * next });
}

/** Moves by a fraction of the window; positive goes later. */
export function pan(range: Range, fraction: number): Range {
  const shift = fraction * (range.x1 - range.x0);
  return settle({ x0: range.x0 + shift, x1: range.x1 + shift });
}

/** The part of a range between two fractions, in either order. */
export function cut(range: Range, one: number, other: number): Range {
  const span = range.x1 - range.x0;
  const low = range.x0 + Math.min(one, other) * span;
  return settle({ x0: low, x1: Math.max(low + SHORTEST, range.x0 + Math.max(one, other) * span) });
}

/** Rounds outward to whole nanoseconds, so that a window can be linked to exactly. */
function settle(range: Range): Range {
  return { x0: Math.floor(range.x0), x1: Math.ceil(range.x1) };
}
