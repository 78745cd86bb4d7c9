import type { LayoutItem } from "../api/contract";

/** A stretch of a skin's taxels that are the columns of one patch. */
export interface SkinPatch {
  /** Its number in the layout. */
  readonly number: number;
  readonly id: string;
  readonly page: number;
  /** Number of its first column among the skin's taxels. */
  readonly first: number;
  readonly columns: number;
}

/** The taxels of one quantity, each where it sits. */
export interface Skin {
  readonly quantity: string;
  readonly unit: string;
  readonly taxels: readonly string[];
  /** Where they sit in the map, in m. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  readonly patches: readonly SkinPatch[];
  readonly threshold: number | null;
}

/** The quantities of a layout that can be shown as a picture: those of which taxels have positions, pressure first. */
export function quantitiesIn(layout: LayoutItem): string[] {
  const placed = layout.patches.filter(({ positions }) => positions.length >= 2);
  const names = [...new Set(placed.map(({ quantity }) => quantity))];
  return names.toSorted((one, other) => Number(other === "pressure") - Number(one === "pressure"));
}

/** Collects the taxels of one quantity. */
export function skinOf(layout: LayoutItem, quantity: string): Skin {
  const patches: SkinPatch[] = [];
  const [taxels, x, y]: [string[], number[], number[]] = [[], [], []];
  let unit = "1";
  let threshold: number | null = null;
  for (const [number, patch] of layout.patches.entries()) {
    const [xs, ys] = patch.positions;
    if (patch.quantity !== quantity || xs === undefined || ys === undefined) continue;
    patches.push({ number, id: patch.patch, page: patch.page, first: taxels.length, columns: patch.taxels.length });
    for (const [column, taxel] of patch.taxels.entries()) {
      taxels.push(taxel);
      x.push(xs[column]!);
      y.push(ys[column]!);
    }
    unit = patch.unit;
    threshold ??= patch.threshold;
  }
  return { quantity, unit, taxels, x: Float64Array.from(x), y: Float64Array.from(y), patches, threshold };
}

function bucketOf(column: number, row: number): number {
  return column * 2 ** 16 + row;
}

/** The typical distance of a taxel to the nearest other one, in m: the median. */
export function pitchOf({ x, y }: Pick<Skin, "x" | "y">): number {
  const count = x.length;
  if (count < 2) return 1e-3;
  const [left, bottom] = [least(x), least(y)];
  const [width, height] = [most(x) - left, most(y) - bottom];
  // Few taxels in each bucket; the nearest one is in the same or an adjacent bucket, or farther away than a bucket.
  const size = Math.max(Math.max(width, height) / Math.sqrt(count), 1e-9);
  const buckets = new Map<number, number[]>();
  const columnOf = (k: number): number => Math.floor((x[k]! - left) / size);
  const rowOf = (k: number): number => Math.floor((y[k]! - bottom) / size);
  for (let k = 0; k < count; k += 1) {
    const bucket = bucketOf(columnOf(k), rowOf(k));
    const held = buckets.get(bucket);
    if (held) held.push(k);
    else buckets.set(bucket, [k]);
  }
  const distances: number[] = [];
  for (let k = 0; k < count; k += 1) {
    let nearest = Infinity;
    for (let i = -1; i <= 1; i += 1) {
      for (let j = -1; j <= 1; j += 1) {
        for (const other of buckets.get(bucketOf(columnOf(k) + i, rowOf(k) + j)) ?? []) {
          const distance = Math.hypot(x[k]! - x[other]!, y[k]! - y[other]!);
          if (distance > 0 && distance < nearest) nearest = distance;
        }
      }
    }
    if (Number.isFinite(nearest)) distances.push(nearest);
  }
  distances.sort((one, other) => one - other);
  return distances[distances.length >> 1] ?? Math.max(width, height, 1e-3);
}

export function least(values: Float64Array): number {
  return values.reduce((found, value) => Math.min(found, value), Infinity);
}

export function most(values: Float64Array): number {
  return values.reduce((found, value) => Math.max(found, value), -Infinity);
}
