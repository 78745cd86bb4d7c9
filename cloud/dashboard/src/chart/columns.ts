import { firstReaching, worstError, type Entries } from "../tube/entries";
import { bottomRow, leftColumn, rightColumn, topRow, xPixel, type PlotMap } from "./plot-map";
import { GREATEST } from "./value-range";

export const OPEN_TOP = 1;
export const OPEN_BOTTOM = 2;

/** One painted stretch for each pixel column: rows [top, bottom), empty where bottom ≤ top. */
export interface Columns {
  readonly top: Int32Array;
  readonly bottom: Int32Array;
  /** OPEN_TOP and OPEN_BOTTOM where a value is unbounded on that side. */
  readonly open: Uint8Array;
}

export interface MarkStyle {
  /** Half the width of a sample's mark in device pixels. */
  readonly halfMark: number;
  /** The least thickness of the band in device pixels. */
  readonly thickness: number;
}

function emptyColumns(width: number): Columns {
  return {
    top: new Int32Array(width).fill(0x7fffffff),
    bottom: new Int32Array(width).fill(-1),
    open: new Uint8Array(width),
  };
}

/**
 * Half the width of a sample's mark. An interval holds at the sampling instants only, so that marks grow
 * with their distance but never meet once there is room between them.
 */
export function halfMarkFor(spacing: number, ratio: number): number {
  return Math.min(Math.max(1.5 * ratio, 0.2 * spacing), 3 * ratio);
}

/**
 * Reduces entries to pixel columns by their hull. Rows and columns round outward, so that the painted
 * area encloses every value; a column without a value stays empty, and nothing is drawn between samples.
 */
export function reduceToColumns(entries: Entries, map: PlotMap, style: MarkStyle): Columns {
  const columns = emptyColumns(map.width);
  const perPixel = (map.xMax - map.xMin) / map.width;
  const { t, width, lo, hi, error } = entries;
  const margin = worstError(entries) + style.halfMark * perPixel;
  for (let i = firstReaching(entries, map.xMin - margin); i < t.length; i += 1) {
    if (t[i]! - margin > map.xMax) break;
    if (Number.isNaN(lo[i]!)) continue;
    const extra = width[i] === 0 ? style.halfMark : 0;
    // A value may lie as far to either side as its time may be wrong.
    const begin = t[i]! - error[i]!;
    const stop = t[i]! + width[i]! + error[i]!;
    const left = extra > 0 ? Math.floor(xPixel(map, begin) - extra) : leftColumn(map, begin);
    const right = extra > 0 ? Math.ceil(xPixel(map, stop) + extra) : rightColumn(map, stop);
    include(columns, map, [left, right], [lo[i]!, hi[i]!]);
  }
  thicken(columns, map.height, style.thickness);
  return columns;
}

function include(columns: Columns, map: PlotMap, reach: [number, number], bounds: [number, number]): void {
  const [lo, hi] = bounds;
  const [above, below] = [hi > GREATEST, lo < -GREATEST];
  const top = above ? 0 : topRow(map, hi);
  const bottom = below ? map.height : bottomRow(map, lo);
  const open = (above ? OPEN_TOP : 0) | (below ? OPEN_BOTTOM : 0);
  const right = Math.min(map.width, Math.max(reach[1], reach[0] + 1));
  for (let column = Math.max(0, reach[0]); column < right; column += 1) {
    if (top < columns.top[column]!) columns.top[column] = top;
    if (bottom > columns.bottom[column]!) columns.bottom[column] = bottom;
    columns.open[column]! |= open;
  }
}

function thicken(columns: Columns, height: number, thickness: number): void {
  for (let column = 0; column < columns.top.length; column += 1) {
    const top = columns.top[column]!;
    const bottom = columns.bottom[column]!;
    if (bottom < 0 || bottom - top >= thickness) continue;
    const more = Math.ceil((thickness - (bottom - top)) / 2);
    columns.top[column] = Math.max(0, Math.min(top - more, height - thickness));
    columns.bottom[column] = Math.min(height, Math.max(bottom + more, thickness));
  }
}
