import type { ChannelItem, TaxelItem, Verdict } from "../api/contract";
import { type Interval, isMissing } from "../interval/interval";

/** Whether a taxel is touched; unknown where it has no value now. */
export type Contact = Verdict | "unknown";

/** Light touches of a fingertip begin about here. */
const TOUCH_PA = 1_000;

/** Judges an interval against a level; null where nothing is known. */
export function judge(interval: Interval | null, level: number): Contact {
  if (interval === null || isMissing(interval)) return "unknown";
  if (interval.lo > level) return "certain";
  return interval.hi > level ? "possible" : "impossible";
}

/** The quantities that several taxels have, pressure first. */
export function quantitiesOf(channels: readonly ChannelItem[], taxels: ReadonlySet<string>): string[] {
  const counts = new Map<string, number>();
  for (const { taxel, quantity } of channels) {
    if (taxels.has(taxel)) counts.set(quantity, (counts.get(quantity) ?? 0) + 1);
  }
  const shared = [...counts].filter(([, count]) => count > 1).map(([quantity]) => quantity);
  const rank = (quantity: string): number => (quantity === "pressure" ? -1 : shared.indexOf(quantity));
  return shared.toSorted((one, other) => rank(one) - rank(other));
}

/** A level to start with: a light touch for a pressure, otherwise the middle of all that was ever measured. */
export function levelOf(channels: readonly ChannelItem[], quantity: string): number {
  const bounds = channels.filter((channel) => channel.quantity === quantity).map((channel) => channel.bounds);
  if (quantity === "pressure") return TOUCH_PA;
  const low = Math.min(...bounds.map((one) => one?.lo ?? Infinity));
  const high = Math.max(...bounds.map((one) => one?.hi ?? -Infinity));
  return Number.isFinite(low) && Number.isFinite(high) ? (low + high) / 2 : 0;
}

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
