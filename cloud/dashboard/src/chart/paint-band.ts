import { OPEN_BOTTOM, OPEN_TOP, type Columns } from "./columns";
import type { Palette } from "./palette";

/** What a painter draws on: the context, moved to the plot's corner, and the device pixels of a CSS pixel. */
export interface Canvas {
  readonly context: CanvasRenderingContext2D;
  readonly palette: Palette;
  readonly ratio: number;
}

const ARROW_PITCH = 14;

/** Whole rectangles of pixels are painted one by one: many in one path would have to be smoothed. */
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

/** The outline, drawn inside the band: one row along each bounded edge, joined by upright steps. */
function paintEdges(context: CanvasRenderingContext2D, columns: Columns, line: number): void {
  const { top, bottom, open } = columns;
  for (let i = 0; i < top.length; i += 1) {
    if (!isPresent(columns, i)) continue;
    if (!(open[i]! & OPEN_TOP)) context.fillRect(i, top[i]!, 1, topReach(columns, i, line) - top[i]!);
    const reach = bottomReach(columns, i, line);
    if (!(open[i]! & OPEN_BOTTOM)) context.fillRect(i, reach, 1, bottom[i]! - reach);
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

/** Paints the band in whole pixels; it never covers less than the columns say. */
export function paintBand(canvas: Canvas, columns: Columns, height: number): void {
  const { context, palette, ratio } = canvas;
  context.fillStyle = palette.colour("band");
  paintFill(context, columns);
  context.fillStyle = palette.colour("band-edge");
  paintEdges(context, columns, Math.max(1, Math.floor(ratio)));
  if (!columns.open.some((open) => open !== 0)) return;
  context.strokeStyle = palette.colour("band-edge");
  context.lineWidth = 1.5 * ratio;
  context.stroke(arrowPath(columns, height, ratio));
}
