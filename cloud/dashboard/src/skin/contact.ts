import type { ChannelItem } from "../api/contract";
import { isMissing, type Interval } from "../interval/interval";

/** Whether a taxel is touched: for every value in its interval, for some, for none; or nothing is known. */
export type Contact = "certain" | "possible" | "none" | "unknown";

/** Light touches of a fingertip begin about here. */
const TOUCH_PA = 1_000;

/** Judges an interval against a level; null where nothing is known. */
export function judge(interval: Interval | null, level: number): Contact {
  if (interval === null || isMissing(interval)) return "unknown";
  if (interval.lo > level) return "certain";
  return interval.hi > level ? "possible" : "none";
}

/** The quantities that several taxels have, most telling first. */
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
