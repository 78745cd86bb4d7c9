import type { LayoutItem } from "../api/contract";
import type { Timeline } from "../time/timeline";
import { type Entries, SAMPLE_REACH } from "../tube/entries";
import type { Stretch } from "./stretches";

/** Where a channel's samples are: a column of a patch. */
export interface Column {
  /** Number of the patch in the layout, and its name. */
  readonly patch: number;
  readonly patchId: string;
  readonly column: number;
}

/** Finds the column of a node's channel, which is named `{taxel}.{quantity}`. */
export function columnOf(layout: LayoutItem, node: string, channel: string): Column | null {
  for (const [number, { node: owner, patch, quantity, taxels }] of layout.patches.entries()) {
    if (owner !== node || !channel.endsWith(`.${quantity}`)) continue;
    const taxel = channel.slice(0, -quantity.length - 1);
    const column = taxels.indexOf(taxel);
    if (column >= 0) return { patch: number, patchId: patch, column };
  }
  return null;
}

/** The samples of one column of a stretch; null where it has none. */
export function runOf(stretch: Stretch, { patch, column }: Pick<Column, "patch" | "column">, timeline: Timeline): Entries | null {
  const samples = stretch.patches.get(patch);
  if (!samples || column >= samples.sampling.columns) return null;
  const { grid } = samples;
  const { columns, strides, firstRow } = samples.sampling;
  const every = strides ? 2 ** strides[column]! : 1;
  const start = stretch.origin + grid.delay;
  const [t, lo, hi]: [number[], number[], number[]] = [[], [], []];
  for (let row = (every - (firstRow % every)) % every; row < grid.rows; row += every) {
    const [low, high] = [samples.samples.lo[row * columns + column]!, samples.samples.hi[row * columns + column]!];
    const missing = low === -Infinity && high === Infinity;
    t.push(start + row * grid.period);
    lo.push(missing ? Number.NaN : low);
    hi.push(missing ? Number.NaN : high);
  }
  const like = (value: number): Float64Array => new Float64Array(t.length).fill(value);
  // Far from the timeline's origin, the numbers that times are painted by leave nanoseconds out.
  const error = stretch.error + timeline.slip(Math.max(Math.abs(start), Math.abs(stretch.end)));
  return {
    t: Float64Array.from(t), width: like(0), lo: Float64Array.from(lo), hi: Float64Array.from(hi),
    doubt: like(1 - grid.coverage), error: like(error), reach: like(SAMPLE_REACH * grid.period * every),
  };
}
