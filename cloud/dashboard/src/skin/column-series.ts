import type { LayoutItem, LiveBlock } from "../api/contract";
import { printInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import type { Stretch } from "./stretches";

/** Where a channel's samples are: a column of a patch. */
export interface Column {
  readonly node: string;
  readonly taxel: string;
  readonly quantity: string;
  readonly unit: string;
  /** Number of the patch in the layout, and its name. */
  readonly patch: number;
  readonly patchId: string;
  readonly column: number;
}

/** Finds the column of a channel named `{taxel}.{quantity}`. */
export function columnOf(layout: LayoutItem, node: string, channel: string): Column | null {
  for (const [number, { patch, quantity, unit, taxels }] of layout.patches.entries()) {
    if (!channel.endsWith(`.${quantity}`)) continue;
    const taxel = channel.slice(0, -quantity.length - 1);
    const column = taxels.indexOf(taxel);
    if (column >= 0) return { node, taxel, quantity, unit, patch: number, patchId: patch, column };
  }
  return null;
}

/** The samples of one column of a stretch, as the live stream gives a channel's; null where it has none. */
export function blockOf(stretch: Stretch, { node, taxel, quantity, unit, patch, column }: Column, timeline: Timeline): LiveBlock | null {
  const samples = stretch.patches.get(patch);
  if (!samples || column >= samples.sampling.columns) return null;
  const { grid } = samples;
  const { columns, strides, firstRow } = samples.sampling;
  const every = strides ? 2 ** strides[column]! : 1;
  const [t, lo, hi]: [number[], (number | null)[], (number | null)[]] = [[], [], []];
  for (let row = 0; row < grid.rows; row += 1) {
    if ((firstRow + row) % every !== 0) continue;
    const [low, high] = [samples.samples.lo[row * columns + column]!, samples.samples.hi[row * columns + column]!];
    t.push(row * grid.period);
    lo.push(low === -Infinity ? null : low);
    hi.push(high === Infinity ? null : high);
  }
  const t0 = printInstant(timeline.toInstant(stretch.origin + grid.delay));
  const head = { node, channel: `${taxel}.${quantity}`, unit, coverage: grid.coverage, resolution: "sample" as const };
  return { ...head, t0, t, lo, hi, dt: grid.period * every, time_error: stretch.error, stored: t0 };
}
