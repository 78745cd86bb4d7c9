import { least, most, pitchOf, type Skin } from "./layout";

/** Taxels are drawn as discs when they have this many pixels; smaller ones touch, and make one surface. */
const DISC_PX = 16;
const DISC_SHARE = 0.44;
const FINEST_PX = 2;
/** One taxel alone is drawn no larger than this. */
const LARGEST_PX = 72;
/** Stripes are so many CSS pixels apart. */
const STRIPE = 4;

/** Where each taxel of a skin lies on a canvas: which pixels are its own, and which of them border on other taxels. */
export interface Raster {
  /** Size of the canvas in its own pixels. */
  readonly width: number;
  readonly height: number;
  /** How many pixels of the canvas a pitch of taxels is. */
  readonly cell: number;
  /** Pixels of taxel k: `pixels[starts[k]]` to `pixels[stripes[k] - 1]`; then those of its stripes, to `starts[k + 1]`. */
  readonly pixels: Int32Array;
  readonly starts: Int32Array;
  readonly stripes: Int32Array;
  /** Border of taxel k: `edges[edgeStarts[k]]` to `edges[edgeStarts[k + 1] - 1]`, and the taxel beyond each, or -1. */
  readonly edges: Int32Array;
  readonly beyond: Int32Array;
  readonly edgeStarts: Int32Array;
  /** Rows of the canvas that taxel k has pixels in: from `tops[k]` to `bottoms[k] - 1`. */
  readonly tops: Int32Array;
  readonly bottoms: Int32Array;
  /** The taxel that a pixel belongs to, or -1. */
  readonly owners: Int32Array;
  /** Centres of the taxels, in pixels of the canvas. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  /** From a place in the map (m) to a pixel. */
  readonly place: (x: number, y: number) => readonly [number, number];
}

/**
 * Lays out a skin on a canvas.
 *
 * @param room the most pixels it may be wide and high
 * @param ratio pixels of the canvas for each CSS pixel
 */
export function rasterise(skin: Skin, room: { width: number; height: number }, ratio: number): Raster {
  const pitch = pitchOf(skin);
  const { left, right, bottom, top } = extentOf(skin, pitch);
  const [columns, rows] = [(right - left) / pitch, (top - bottom) / pitch];
  // Whole pixels for each taxel: an even picture, without seams.
  const fitting = Math.floor(Math.min(room.width / columns, room.height / rows, LARGEST_PX * ratio));
  const cell = Math.max(FINEST_PX, fitting);
  const scale = cell / pitch;
  const [width, height] = [Math.max(1, Math.ceil(columns * cell)), Math.max(1, Math.ceil(rows * cell))];
  const place = (x: number, y: number): readonly [number, number] => [(x - left) * scale, (top - y) * scale];
  const count = skin.taxels.length;
  const [x, y] = [new Float64Array(count), new Float64Array(count)];
  for (let k = 0; k < count; k += 1) [x[k], y[k]] = place(skin.x[k]!, skin.y[k]!);
  const owners = ownersOf(x, y, { width, height, cell, disc: cell >= DISC_PX * ratio });
  const areas = pixelsOf(owners, width, count, ratio);
  const borders = bordersOf(owners, { width, height, count, thickness: Math.max(1, Math.round(Math.min(cell / 5, 2 * ratio))) });
  return { width, height, cell, owners, x, y, place, ...areas, ...borders };
}

/** What a picture shows of the map, in m: all cells, and the whole outline with its line. */
function extentOf({ x, y, outline }: Skin, pitch: number): { left: number; right: number; bottom: number; top: number } {
  const [half, line] = [pitch / 2, pitch / 16];
  return {
    left: Math.min(least(x) - half, ...outline.map((each) => least(each.x) - line)),
    right: Math.max(most(x) + half, ...outline.map((each) => most(each.x) + line)),
    bottom: Math.min(least(y) - half, ...outline.map((each) => least(each.y) - line)),
    top: Math.max(most(y) + half, ...outline.map((each) => most(each.y) + line)),
  };
}

interface Cells {
  readonly width: number;
  readonly height: number;
  readonly cell: number;
  readonly disc: boolean;
}

/** Gives each pixel to the taxel whose centre is nearest, if it is no farther than half a cell in x and in y. */
function ownersOf(x: Float64Array, y: Float64Array, { width, height, cell, disc }: Cells): Int32Array {
  const owners = new Int32Array(width * height).fill(-1);
  const nearest = new Float32Array(width * height).fill(Infinity);
  const half = cell / 2;
  const radius = disc ? DISC_SHARE * cell : Infinity;
  for (let k = 0; k < x.length; k += 1) {
    const [cx, cy] = [x[k]!, y[k]!];
    const [x0, x1] = [Math.max(0, Math.round(cx - half)), Math.min(width, Math.round(cx + half))];
    const [y0, y1] = [Math.max(0, Math.round(cy - half)), Math.min(height, Math.round(cy + half))];
    for (let row = y0; row < y1; row += 1) {
      for (let column = x0; column < x1; column += 1) {
        const distance = Math.hypot(column + 0.5 - cx, row + 0.5 - cy);
        const pixel = row * width + column;
        if (distance > radius || distance >= nearest[pixel]!) continue;
        nearest[pixel] = distance;
        owners[pixel] = k;
      }
    }
  }
  return owners;
}

function pixelsOf(owners: Int32Array, width: number, count: number, ratio: number): Pick<Raster, "pixels" | "starts" | "stripes" | "tops" | "bottoms"> {
  const period = Math.round(STRIPE * ratio);
  const thickness = Math.max(1, Math.round(ratio));
  const isStripe = (pixel: number): boolean => ((pixel % width) + Math.floor(pixel / width)) % period < thickness;
  const [plain, striped] = [new Int32Array(count), new Int32Array(count)];
  const [tops, bottoms] = [new Int32Array(count).fill(owners.length), new Int32Array(count)];
  for (let pixel = 0; pixel < owners.length; pixel += 1) {
    const k = owners[pixel]!;
    if (k < 0) continue;
    (isStripe(pixel) ? striped : plain)[k]! += 1;
    const row = Math.floor(pixel / width);
    tops[k] = Math.min(tops[k]!, row);
    bottoms[k] = row + 1;
  }
  const [starts, stripes] = [new Int32Array(count + 1), new Int32Array(count)];
  for (let k = 0; k < count; k += 1) {
    stripes[k] = starts[k]! + plain[k]!;
    starts[k + 1] = stripes[k]! + striped[k]!;
  }
  const [nextPlain, nextStripe] = [starts.slice(), stripes.slice()];
  const pixels = new Int32Array(starts[count]!);
  for (let pixel = 0; pixel < owners.length; pixel += 1) {
    const k = owners[pixel]!;
    if (k < 0) continue;
    const next = isStripe(pixel) ? nextStripe : nextPlain;
    pixels[next[k]!] = pixel;
    next[k]! += 1;
  }
  return { pixels, starts, stripes, tops, bottoms };
}

interface Bordered {
  readonly width: number;
  readonly height: number;
  readonly count: number;
  readonly thickness: number;
}

function bordersOf(owners: Int32Array, { width, height, count, thickness }: Bordered): Pick<Raster, "edges" | "beyond" | "edgeStarts"> {
  const found: number[][] = Array.from({ length: count }, () => []);
  for (let pixel = 0; pixel < owners.length; pixel += 1) {
    const k = owners[pixel]!;
    if (k < 0) continue;
    const [column, row] = [pixel % width, Math.floor(pixel / width)];
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
      for (let step = 1; step <= thickness; step += 1) {
        const [toX, toY] = [column + step * dx, row + step * dy];
        const inside = toX >= 0 && toX < width && toY >= 0 && toY < height;
        const other = inside ? owners[toY * width + toX]! : -1;
        if (other === k) continue;
        found[k]!.push(pixel, other);
        break;
      }
    }
  }
  const edgeStarts = new Int32Array(count + 1);
  for (let k = 0; k < count; k += 1) edgeStarts[k + 1] = edgeStarts[k]! + found[k]!.length / 2;
  const [edges, beyond] = [new Int32Array(edgeStarts[count]!), new Int32Array(edgeStarts[count]!)];
  for (let k = 0; k < count; k += 1) {
    for (let i = 0; i < found[k]!.length; i += 2) {
      edges[edgeStarts[k]! + i / 2] = found[k]![i]!;
      beyond[edgeStarts[k]! + i / 2] = found[k]![i + 1]!;
    }
  }
  return { edges, beyond, edgeStarts };
}

/** The taxel at a pixel, or the nearest one within a cell of it; -1 where there is none. */
export function taxelAt(raster: Raster, x: number, y: number): number {
  const [column, row] = [Math.floor(x), Math.floor(y)];
  if (column >= 0 && column < raster.width && row >= 0 && row < raster.height) {
    const owner = raster.owners[row * raster.width + column]!;
    if (owner >= 0) return owner;
  }
  let [nearest, distance] = [-1, raster.cell];
  for (let k = 0; k < raster.x.length; k += 1) {
    const to = Math.hypot(raster.x[k]! - x, raster.y[k]! - y);
    if (to < distance) [nearest, distance] = [k, to];
  }
  return nearest;
}

/** The taxels whose centres lie in a box. */
export function taxelsWithin(raster: Raster, box: { x0: number; y0: number; x1: number; y1: number }): number[] {
  const found: number[] = [];
  for (let k = 0; k < raster.x.length; k += 1) {
    if (raster.x[k]! >= box.x0 && raster.x[k]! <= box.x1 && raster.y[k]! >= box.y0 && raster.y[k]! <= box.y1) found.push(k);
  }
  return found;
}

/** The nearest taxel in a direction, preferring what lies straight ahead; the taxel itself where there is none. */
export function taxelBeside(raster: Raster, taxel: number, direction: readonly [number, number]): number {
  const [dx, dy] = direction;
  let [nearest, cost] = [taxel, Infinity];
  for (let k = 0; k < raster.x.length; k += 1) {
    const [toX, toY] = [raster.x[k]! - raster.x[taxel]!, raster.y[k]! - raster.y[taxel]!];
    const ahead = toX * dx + toY * dy;
    const aside = Math.abs(toX * dy) + Math.abs(toY * dx);
    if (ahead < 0.4 * raster.cell || aside > ahead) continue;
    if (ahead + 2 * aside < cost) [nearest, cost] = [k, ahead + 2 * aside];
  }
  return nearest;
}
