import { formatCount, formatCoverage, formatInterval } from "../interval/format";
import { readInterval } from "../interval/interval";
import { formatDuration } from "../time/duration";
import { decimalsFor, parseInstant, printClock } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { type Entries, firstAtOrAfter, firstReaching, hullWithin } from "../tube/entries";
import type { PeakMark } from "./peaks";
import type { TipLine, TipText } from "./tooltip";
import { finiteExtent } from "./value-range";

/** What is known about a channel besides its values. */
export interface ChannelFacts {
  readonly unit: string;
  /** Whether the channel measures in bursts, so that silence between them is as it should be. */
  readonly bursts: boolean;
}

/** What was found at a place of the chart. */
export interface Reading {
  readonly x: number;
  readonly text: TipText;
}

function nearest(entries: Entries, x: number, reach: number): number | null {
  const after = firstAtOrAfter(entries.t, x);
  let best: number | null = null;
  let distance = reach;
  for (const index of [after - 1, after]) {
    if (index < 0 || index >= entries.t.length || Number.isNaN(entries.lo[index]!)) continue;
    const begin = entries.t[index]!;
    const away = x < begin ? begin - x : Math.max(0, x - begin - entries.width[index]!);
    if (away <= distance) [best, distance] = [index, away];
  }
  return best;
}

function span(timeline: Timeline, from: number, to: number, perPixel: number): string {
  const decimals = decimalsFor(Math.min(2e9, perPixel * 100));
  const begin = printClock(timeline.toInstant(from), decimals);
  if (to <= from) return begin;
  return `${begin} + ${formatDuration(to - from, "up")}`;
}

/**
 * Reads the value at x: of all entries within one pixel the hull, otherwise the nearest within reach. Its coverage
 * is a union bound over them, and its time as uncertain as the worst of theirs.
 *
 * @param perPixel the width of a CSS pixel in ns
 */
export function readValue(
  entries: Entries,
  timeline: Timeline,
  facts: ChannelFacts,
  at: { x: number; perPixel: number },
): Reading | null {
  const { x, perPixel } = at;
  const centre = nearest(entries, x, 12 * perPixel);
  if (centre === null) return null;
  let [from, to] = [entries.t[centre]!, entries.t[centre]! + entries.width[centre]!];
  let [lo, hi] = [entries.lo[centre]!, entries.hi[centre]!];
  let [doubt, error] = [entries.doubt[centre]!, entries.error[centre]!];
  let count = 1;
  for (let i = firstReaching(entries, x - perPixel / 2); i < entries.t.length; i += 1) {
    if (entries.t[i]! > x + perPixel / 2) break;
    if (i === centre || Number.isNaN(entries.lo[i]!)) continue;
    lo = Math.min(lo, entries.lo[i]!);
    hi = Math.max(hi, entries.hi[i]!);
    from = Math.min(from, entries.t[i]!);
    to = Math.max(to, entries.t[i]! + entries.width[i]!);
    doubt += entries.doubt[i]!;
    error = Math.max(error, entries.error[i]!);
    count += 1;
  }
  const sample = count === 1 && entries.width[centre] === 0;
  const lines: TipLine[] = [{ name: sample ? "at" : "over", value: span(timeline, from, to, perPixel) }];
  if (error > 0) lines.push({ name: "time", value: `± ${formatDuration(error, "up")}` });
  lines.push({ name: "coverage", value: formatCoverage(Math.max(0, 1 - doubt)) });
  const title = formatInterval({ lo, hi }, facts.unit);
  return { x: (from + to) / 2, text: { title, kind: sample ? "sample" : "hull of samples", lines } };
}

/** The middle of the first known entry at or beyond x, going later (1) or earlier (-1). */
export function nextKnown(entries: Entries, x: number, direction: 1 | -1): number | null {
  const start = direction === 1 ? firstReaching(entries, x) : firstAtOrAfter(entries.t, x) - 1;
  for (let i = start; i >= 0 && i < entries.t.length; i += direction) {
    const middle = entries.t[i]! + entries.width[i]! / 2;
    if (!Number.isNaN(entries.lo[i]!) && direction * (middle - x) >= 0) return middle;
  }
  return null;
}

/** Says which values a window holds: its hull, or its finite part where some are unbounded. */
export function describeHull(entries: Entries, range: { x0: number; x1: number }, unit: string): string {
  const hull = hullWithin(entries, range.x0, range.x1);
  if (hull.count === 0) return "–";
  if (Number.isFinite(hull.lo) && Number.isFinite(hull.hi)) return formatInterval(hull, unit);
  const finite = finiteExtent(entries, range.x0, range.x1);
  const known = finite === null ? "" : `${formatInterval({ lo: finite.min, hi: finite.max }, unit)}, `;
  return `${known}unbounded in parts`;
}

function readGroupText(mark: PeakMark, unit: string): TipText {
  const lines: TipLine[] = [
    { name: "certain", value: `at least ${formatCount({ lo: mark.count.lo, hi: mark.count.lo })}` },
    { name: "heights", value: formatInterval(mark, unit) },
    { name: "within", value: formatDuration(mark.x1 - mark.x0, "up") },
  ];
  return { title: `${formatCount(mark.count)} peaks`, kind: "zoom in to separate them", lines };
}

/** Describes a peak in a tooltip. */
export function readPeakText(mark: PeakMark, unit: string): TipText {
  const { event } = mark;
  if (mark.events > 1) return readGroupText(mark, unit);
  const begin = parseInstant(event.time.lo);
  const length = Number(parseInstant(event.time.hi) - begin);
  const clock = printClock(begin, decimalsFor(Math.min(length / 2, 1e9)));
  const time = length > 0 ? `${clock} + ${formatDuration(length, "up")}` : clock;
  const lines: TipLine[] = [{ name: "height", value: formatInterval(mark, unit) }];
  if (event.prominence) lines.push({ name: "prominence", value: formatInterval(readInterval(event.prominence), unit) });
  lines.push({ name: "count", value: formatCount(mark.count) });
  lines.push({ name: "time", value: time });
  if (event.coverage !== null) lines.push({ name: "coverage", value: formatCoverage(event.coverage) });
  return { title: `${mark.verdict} peak`, lines };
}
