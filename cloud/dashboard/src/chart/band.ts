import { type Entries, firstReaching, worstError } from "../tube/entries";
import type { Palette } from "./palette";
import { bottomRow, leftColumn, type PlotMap, rightColumn, topRow, xPixel } from "./plot-map";
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

/** What a painter draws on: the context, moved to the plot's corner, and the device pixels of a CSS pixel. */
export interface Canvas {
  readonly context: CanvasRenderingContext2D;
  readonly palette: Palette;
  readonly ratio: number;
}

const ARROW_PITCH = 14;

/** Fills columns by whole rectangles, one by one: many in one path would have to be smoothed. */
export function paintFill(context: CanvasRenderingContext2D, { top, bottom }: Columns): void {
  for (let start = 0; start < top.length; ) {
    let stop = start + 1;
    while (stop < top.length && top[stop] === top[start] && bottom[stop] === bottom[start]) stop += 1;
    const height = bottom[start]! - top[start]!;
    if (height > 0) context.fillRect(start, top[start]!, stop - start, height);
    start = stop;
  }
}

function isPresent({ top, bottom }: Columns, i: number): boolean {
  return i >= 0 && i < top.length && bottom[i]! > top[i]!;
}

/** How far down the upper edge reaches in a column: to its neighbours' upper edges, within the column. */
function topReach(columns: Columns, i: number, line: number): number {
  const { top, bottom } = columns;
  let reach = top[i]! + line;
  for (let n = i - 1; n <= i + 1; n += 2) if (isPresent(columns, n)) reach = Math.max(reach, Math.min(top[n]!, bottom[i]!));
  return reach;
}

function bottomReach(columns: Columns, i: number, line: number): number {
  const { top, bottom } = columns;
  let reach = bottom[i]! - line;
  for (let n = i - 1; n <= i + 1; n += 2) if (isPresent(columns, n)) reach = Math.min(reach, Math.max(bottom[n]!, top[i]!));
  return reach;
}

/** Pixels of a band, over nothing: row by row, each column filled from its top to its bottom within its outline. */
export function rasterBand(columns: Columns, pixels: Uint32Array, ink: { fill: number; edge: number; line: number }): void {
  const { top, bottom, open } = columns;
  const width = top.length;
  pixels.fill(0);
  const stroke = (column: number, from: number, to: number, pixel: number): void => {
    for (let at = from * width + column; at < to * width; at += width) pixels[at] = pixel;
  };
  for (let i = 0; i < width; i += 1) {
    if (!isPresent(columns, i)) continue;
    stroke(i, top[i]!, bottom[i]!, ink.fill);
    if (!(open[i]! & OPEN_TOP)) stroke(i, top[i]!, topReach(columns, i, ink.line), ink.edge);
    if (!(open[i]! & OPEN_BOTTOM)) stroke(i, bottomReach(columns, i, ink.line), bottom[i]!, ink.edge);
  }
}

/** Marks the unbounded sides: arrow heads at the plot's edge, wherever the band runs out of it. */
function arrowPath(columns: Columns, height: number, ratio: number): Path2D {
  const path = new Path2D();
  const size = 4 * ratio;
  const next = { top: 0, bottom: 0 };
  for (let i = 0; i < columns.open.length; i += 1) {
    const open = columns.open[i]!;
    if (open & OPEN_TOP && i >= next.top) {
      path.moveTo(i - size, size + ratio);
      path.lineTo(i, ratio);
      path.lineTo(i + size, size + ratio);
      next.top = i + ARROW_PITCH * ratio;
    }
    if (open & OPEN_BOTTOM && i >= next.bottom) {
      path.moveTo(i - size, height - size - ratio);
      path.lineTo(i, height - ratio);
      path.lineTo(i + size, height - size - ratio);
      next.bottom = i + ARROW_PITCH * ratio;
    }
  }
  return path;
}

/**
 * Paints bands in whole pixels; they never cover less than their columns say. The outline has rectangles without
 * number, which a canvas takes far longer for than for the same pixels at a time.
 */
export class BandPainter {
  private readonly sheet = document.createElement("canvas");
  private readonly pen = this.sheet.getContext("2d", { willReadFrequently: true });
  private image: ImageData | null = null;
  private pixels = new Uint32Array(0);

  paint(canvas: Canvas, columns: Columns, height: number): void {
    const { context, palette, ratio } = canvas;
    const width = columns.top.length;
    const image = this.sized(width, height);
    const line = Math.max(1, Math.floor(ratio));
    rasterBand(columns, this.pixels, { fill: palette.pixel("band"), edge: palette.pixel("band-edge"), line });
    this.pen?.putImageData(image, 0, 0);
    context.drawImage(this.sheet, 0, 0);
    if (!columns.open.some((open) => open !== 0)) return;
    context.strokeStyle = palette.colour("band-edge");
    context.lineWidth = 1.5 * ratio;
    context.stroke(arrowPath(columns, height, ratio));
  }

  private sized(width: number, height: number): ImageData {
    if (this.image?.width === width && this.image.height === height) return this.image;
    [this.sheet.width, this.sheet.height] = [width, height];
    this.image = new ImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    return this.image;
  }
}
