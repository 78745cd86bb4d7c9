import { OPEN_BOTTOM, OPEN_TOP, type Columns } from "./columns";
import type { Palette } from "./palette";

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
