import { eachWithin, type Entries } from "../tube/entries";

export interface ValueRange {
  readonly min: number;
  readonly max: number;
}

const ROOM_BELOW = 0.08;
const ROOM_ABOVE = 0.18;
/** A range may be so many times too wide before it is drawn in again: a calm scale is easier to read. */
const CALM = 1.6;

/** What is greater is painted as unbounded: sums and differences of such numbers may be none. */
export const GREATEST = 1e307;

/** The finite extent of the entries that are painted in a window; null where no bound is finite. */
export function finiteExtent(entries: Entries, from: number, to: number): ValueRange | null {
  let min = Infinity;
  let max = -Infinity;
  eachWithin(entries, from, to, (i) => {
    for (const side of [entries.lo[i]!, entries.hi[i]!]) {
      if (!Number.isFinite(side)) continue;
      min = Math.min(min, side);
      max = Math.max(max, side);
    }
  });
  return min <= max ? { min, max } : null;
}

/** The finite extent of several runs in a window. */
export function finiteExtentOf(runs: readonly Entries[], from: number, to: number): ValueRange | null {
  const extents = runs.map((entries) => finiteExtent(entries, from, to)).filter((extent) => extent !== null);
  if (extents.length === 0) return null;
  return { min: Math.min(...extents.map(({ min }) => min)), max: Math.max(...extents.map(({ max }) => max)) };
}

/** Adds room around an extent, for the peaks' triangles above and so that a flat line has a scale. */
function withRoom(extent: ValueRange): ValueRange {
  const size = extent.max - extent.min;
  const least = Math.max(Math.abs(extent.max), Math.abs(extent.min)) * 1e-9;
  const span = size > least ? size : Math.max(Math.abs(extent.max) * 0.02, least, 1e-30);
  return { min: extent.min - ROOM_BELOW * span, max: extent.max + ROOM_ABOVE * span };
}

function paintable(value: number): number {
  return Math.max(-GREATEST, Math.min(GREATEST, value));
}

/** The next range to show: grows at once, and shrinks only when it has become far too wide. */
export function calmRange(shown: ValueRange | null, found: ValueRange | null): ValueRange {
  if (found === null) return shown ?? { min: 0, max: 1 };
  const extent = { min: paintable(found.min), max: paintable(found.max) };
  const wanted = withRoom(extent);
  if (shown === null) return wanted;
  const inside = extent.min >= shown.min && extent.max <= shown.max - 0.1 * (shown.max - shown.min);
  const tooWide = shown.max - shown.min > CALM * (wanted.max - wanted.min);
  if (inside && !tooWide) return shown;
  if (tooWide) return wanted;
  return { min: Math.min(shown.min, wanted.min), max: Math.max(shown.max, wanted.max) };
}
