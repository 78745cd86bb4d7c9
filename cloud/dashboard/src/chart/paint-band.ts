import { OPEN_BOTTOM, OPEN_TOP, type Columns } from "./columns";
import type { Palette } from "./palette";

/** What a painter draws on: the context, moved to the plot's corner, and the device pixels of a CSS pixel. */
export interface Canvas {
  readonly context: CanvasRenderingContext2D;
  readonly palette: Palette;
  readonly ratio: number;
}

const ARROW_PITCH = 14;

function fillPath(columns: Columns): Path2D {
  const path = new Path2D();
  const { top, bottom } = columns;
  for (let start = 0; start < top.length; ) {
    let stop = start + 1;
    while (stop < top.length && top[stop] === top[start] && bottom[stop] === bottom[start]) stop += 1;
    if (bottom[start]! > top[start]!) path.rect(start, top[start]!, stop - start, bottom[start]! - top[start]!);
    start = stop;
  }
  return path;
}

/** The outline, drawn inside the band: one row along each bounded edge, joined by upright steps. */
function edgePath(columns: Columns, line: number): Path2D {
  const path = new Path2D();
  const { top, bottom, open } = columns;
  const present = (i: number): boolean => i >= 0 && i < top.length && bottom[i]! > top[i]!;
  for (let i = 0; i < top.length; i += 1) {
    if (!present(i)) continue;
    const high = top[i]!;
    const low = bottom[i]!;
    const neighbours = [i - 1, i + 1].filter(present);
    if (!(open[i]! & OPEN_TOP)) {
      const reach = Math.max(high + line, ...neighbours.map((n) => Math.min(top[n]!, low)));
      path.rect(i, high, 1, reach - high);
    }
    if (!(open[i]! & OPEN_BOTTOM)) {
      const reach = Math.min(low - line, ...neighbours.map((n) => Math.max(bottom[n]!, high)));
      path.rect(i, reach, 1, low - reach);
    }
  }
  return path;
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
  context.fill(fillPath(columns));
  context.fillStyle = palette.colour("band-edge");
  context.fill(edgePath(columns, Math.max(1, Math.floor(ratio))));
  if (!columns.open.some((open) => open !== 0)) return;
  context.strokeStyle = palette.colour("band-edge");
  context.lineWidth = 1.5 * ratio;
  context.stroke(arrowPath(columns, height, ratio));
}
