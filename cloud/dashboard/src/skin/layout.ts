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

/** The taxels of one quantity. */
export interface Taxels {
  readonly quantity: string;
  readonly unit: string;
  readonly taxels: readonly string[];
  /** The node that sends each of them. */
  readonly nodes: readonly string[];
  readonly patches: readonly SkinPatch[];
}

/** A line whose last point is joined to its first. */
export interface ClosedLine {
  readonly x: readonly number[];
  readonly y: readonly number[];
}

/** The taxels of one quantity, each where it sits. */
export interface Skin extends Taxels {
  /** Where they sit in the map, in m. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  /** Closed lines around it on the same map, in m. */
  readonly outline: readonly ClosedLine[];
  /** From which value on a taxel is pressed; null: none is judged. */
  readonly threshold: number | null;
}

/** The quantities of a layout that can be shown as a picture: those of which taxels have positions, pressure first. */
export function quantitiesIn(layout: LayoutItem): string[] {
  const placed = layout.patches.filter(({ positions }) => positions.length >= 2);
  const names = [...new Set(placed.map(({ quantity }) => quantity))];
  return names.toSorted((one, other) => Number(other === "pressure") - Number(one === "pressure"));
}

/** Collects the taxels of one quantity that have a place. */
export function skinOf(layout: LayoutItem, quantity: string): Skin {
  const [x, y]: [number[], number[]] = [[], []];
  let threshold: number | null = null;
  const found = taxelsOf(layout, quantity, (patch) => {
    const [xs, ys] = patch.positions;
    if (xs === undefined || ys === undefined) return false;
    x.push(...xs);
    y.push(...ys);
    threshold ??= patch.threshold;
    return true;
  });
  const outline = layout.outline.map(([xs, ys]) => ({ x: xs, y: ys }));
  return { ...found, x: Float64Array.from(x), y: Float64Array.from(y), outline, threshold };
}

/** Collects the taxels of one quantity: those of all its patches, or of those that a function chooses. */
export function taxelsOf(layout: LayoutItem, quantity: string, chosen: (patch: LayoutItem["patches"][number]) => boolean = () => true): Taxels {
  const patches: SkinPatch[] = [];
  const [taxels, nodes]: [string[], string[]] = [[], []];
  let unit = "1";
  for (const [number, patch] of layout.patches.entries()) {
    if (patch.quantity !== quantity || !chosen(patch)) continue;
    patches.push({ number, id: patch.patch, page: patch.page, first: taxels.length, columns: patch.taxels.length });
    for (const taxel of patch.taxels) {
      taxels.push(taxel);
      nodes.push(patch.node);
    }
    unit = patch.unit;
  }
  return { quantity, unit, taxels, nodes, patches };
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

export function least(values: Iterable<number>): number {
  let found = Infinity;
  for (const value of values) found = Math.min(found, value);
  return found;
}

export function most(values: Iterable<number>): number {
  let found = -Infinity;
  for (const value of values) found = Math.max(found, value);
  return found;
}
