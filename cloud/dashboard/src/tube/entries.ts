/**
 * A run of interval values in the order of time. An entry of width 0 is a sample: its interval holds at
 * its instant only. An entry of positive width is a hull: it encloses every sample in [t, t + width).
 * NaN bounds mean that nothing is known from here on (a gap); infinities are unbounded sides.
 */
export interface Entries {
  readonly t: Float64Array;
  readonly width: Float64Array;
  readonly lo: Float64Array;
  readonly hi: Float64Array;
  /** Of each entry, the probability at most that some sample of it is not enclosed: 1 - coverage. */
  readonly doubt: Float64Array;
  /** Of each entry, how far its true times may lie from the stated ones, in ns. */
  readonly error: Float64Array;
  /** Of each entry, within how much after it (ns) the next one follows without a break. */
  readonly reach: Float64Array;
}

/** The next sample follows without a break within so many periods; the next hull within so many of its widths. */
export const SAMPLE_REACH = 1.5;
export const HULL_REACH = 0.5;

export type Column = keyof Entries;
export const COLUMNS: readonly Column[] = ["t", "width", "lo", "hi", "doubt", "error", "reach"];

/** A run of which each column is made by a function. */
export function byColumn(make: (column: Column) => Float64Array): { [Name in Column]: Float64Array } {
  return {
    t: make("t"), width: make("width"), lo: make("lo"), hi: make("hi"), doubt: make("doubt"), error: make("error"), reach: make("reach"),
  };
}

export const NOTHING: Entries = byColumn(() => new Float64Array(0));

/** The entries [from, to) of a run, without copying. */
export function part(entries: Entries, from: number, to: number): Entries {
  return byColumn((column) => entries[column].subarray(from, to));
}

/** A copy that stays as it is. */
export function copyOf(entries: Entries): Entries {
  return byColumn((column) => entries[column].slice());
}

/** The index of the first entry at or after x. */
export function firstAtOrAfter(t: Float64Array, x: number): number {
  let low = 0;
  let high = t.length;
  while (low < high) {
    const middle = (low + high) >>> 1;
    if (t[middle]! < x) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** The index of the first entry that covers x or a later instant. */
export function firstBeyond({ t, width }: Entries, x: number): number {
  let index = firstAtOrAfter(t, x);
  while (index > 0 && t[index - 1]! + width[index - 1]! > x) index -= 1;
  return index;
}

/** The index of the first entry that touches x or comes later. */
export function firstReaching(entries: Entries, x: number): number {
  let index = firstAtOrAfter(entries.t, x);
  while (index > 0 && entries.t[index - 1]! + entries.width[index - 1]! >= x) index -= 1;
  return index;
}

/** Where a hull of this entry stops: a hull is open at its end, so that of a sample is one nanosecond wide. */
export function stopOf({ t, width }: Entries, index: number): number {
  return t[index]! + (width[index]! || 1);
}

/** Where the run ends: the last instant that it speaks of, or null for an empty run. */
export function endOf(entries: Entries): number | null {
  const last = entries.t.length - 1;
  return last < 0 ? null : entries.t[last]! + entries.width[last]!;
}

/** The part of a run before x. A hull that reaches beyond is cut short: it still encloses what is left. */
export function clipEnd(entries: Entries, x: number): Entries {
  const count = firstAtOrAfter(entries.t, x);
  const width = entries.width.slice(0, count);
  for (let i = count - 1; i >= 0 && entries.t[i]! + width[i]! > x; i -= 1) width[i] = x - entries.t[i]!;
  return { ...part(entries, 0, count), width };
}

/** Whether an entry goes on to the next one without a break. */
export function goesOn({ t, width, reach }: Entries, index: number): boolean {
  return t[index + 1]! - t[index]! - width[index]! <= reach[index]!;
}

/** The least time between two samples of a run, in ns; Infinity where it has none. */
export function leastSpacing({ width, reach }: Entries): number {
  let least = Infinity;
  for (let i = 0; i < width.length; i += 1) if (width[i] === 0 && reach[i]! < least) least = reach[i]!;
  return least / SAMPLE_REACH;
}

/** The greatest error of time of a run, in ns. */
export function worstError({ error }: Entries): number {
  let most = 0;
  for (let i = 0; i < error.length; i += 1) if (error[i]! > most) most = error[i]!;
  return most;
}

/** Calls for each known entry that may touch [from, to], within its time error. */
export function eachWithin(entries: Entries, from: number, to: number, found: (index: number) => void): void {
  const { t, width, lo, error } = entries;
  const margin = worstError(entries);
  for (let i = firstReaching(entries, from - margin); i < t.length && t[i]! - margin <= to; i += 1) {
    const touches = t[i]! - error[i]! <= to && t[i]! + width[i]! + error[i]! >= from;
    if (touches && !Number.isNaN(lo[i]!)) found(i);
  }
}

/** The hull of the known entries that may touch [from, to]; NaN where there is none. */
export function hullWithin(entries: Entries, from: number, to: number): { lo: number; hi: number; count: number } {
  let lo = Infinity;
  let hi = -Infinity;
  let count = 0;
  eachWithin(entries, from, to, (i) => {
    lo = Math.min(lo, entries.lo[i]!);
    hi = Math.max(hi, entries.hi[i]!);
    count += 1;
  });
  return count === 0 ? { lo: Number.NaN, hi: Number.NaN, count } : { lo, hi, count };
}
