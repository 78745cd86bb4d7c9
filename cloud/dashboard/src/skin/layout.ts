import type { TaxelItem } from "../api/contract";

/** Where a taxel is drawn, in units of the picture's box. */
export interface Spot {
  readonly taxel: string;
  readonly x: number;
  readonly y: number;
}

export interface Layout {
  readonly spots: readonly Spot[];
  readonly width: number;
  readonly height: number;
}

/** The least distance of two taxels is drawn as so many units; a taxel has a radius of less than half. */
export const PITCH = 20;

function nearest(taxels: readonly TaxelItem[]): number {
  let least = Infinity;
  for (const [index, { position_m: one }] of taxels.entries()) {
    for (const { position_m: other } of taxels.slice(index + 1)) {
      const distance = Math.hypot(one[0] - other[0], one[1] - other[1]);
      if (distance > 0) least = Math.min(least, distance);
    }
  }
  return Number.isFinite(least) ? least : 1;
}

/** Lays out a skin's map, x to the right and y upwards, with the nearest two taxels a pitch apart. */
export function layOut(taxels: readonly TaxelItem[]): Layout {
  const scale = PITCH / nearest(taxels);
  const xs = taxels.map(({ position_m: [x] }) => x * scale);
  const ys = taxels.map(({ position_m: [, y] }) => y * scale);
  const left = Math.min(...xs);
  const top = Math.max(...ys);
  return {
    spots: taxels.map(({ id }, index) => ({
      taxel: id,
      x: xs[index]! - left + PITCH / 2,
      y: top - ys[index]! + PITCH / 2,
    })),
    width: Math.max(...xs) - left + PITCH,
    height: top - Math.min(...ys) + PITCH,
  };
}
