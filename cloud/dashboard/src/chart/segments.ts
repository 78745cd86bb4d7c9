import type { Verdict, VerdictItem } from "../api/contract";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { type Entries, firstReaching } from "../tube/entries";
import type { Canvas } from "./band";
import { leftColumn, type PlotMap, rightColumn, yPixel } from "./plot-map";

/** A stretch of time with an answer to a threshold question. */
export interface Segment {
  readonly x0: number;
  readonly x1: number;
  readonly verdict: Verdict;
  /** How far both ends may be from where they stand, as numbers are rounded, in ns. */
  readonly error: number;
}

/** Which pixel columns the answers of a question touch. */
export interface Lanes {
  readonly certain: Uint8Array;
  readonly possible: Uint8Array;
}

/** Reads a stretch of the REST API. */
export function readSegment({ start, end, verdict }: Pick<VerdictItem, "start" | "end" | "verdict">, timeline: Timeline): Segment {
  const [x0, x1] = [timeline.toX(parseInstant(start)), timeline.toX(parseInstant(end))];
  return { x0, x1, verdict, error: timeline.slip(Math.max(Math.abs(x0), Math.abs(x1))) };
}

/** A stretch of time of which nothing is known. */
export interface Stretch {
  readonly x0: number;
  readonly x1: number;
}

const LANE_HEIGHT = 6;

/** The stretches within a window that begin with a missing entry and end with the next known one. */
export function missingStretches(entries: Entries, from: number, to: number): Stretch[] {
  const stretches: Stretch[] = [];
  let begin: number | null = null;
  for (let i = Math.max(0, firstReaching(entries, from) - 1); i < entries.t.length; i += 1) {
    const missing = Number.isNaN(entries.lo[i]!);
    if (missing && begin === null) begin = entries.t[i]!;
    if (!missing && begin !== null) {
      stretches.push({ x0: begin, x1: entries.t[i]! });
      begin = null;
    }
    if (entries.t[i]! > to) break;
  }
  const last = entries.t.length - 1;
  if (begin !== null) stretches.push({ x0: begin, x1: entries.t[last]! + entries.width[last]! });
  return stretches;
}

/** A silence so many times longer than the pauses between bursts is no pause. */
const LONGEST_PAUSE = 3;

/** Leaves out the pauses of a channel that measures in bursts: there, silence is as it should be. */
export function withoutPauses(stretches: readonly Stretch[]): Stretch[] {
  const lengths = stretches.map(({ x0, x1 }) => x1 - x0).toSorted((one, other) => one - other);
  const usual = lengths.length < 3 ? Infinity : lengths[Math.floor(lengths.length / 2)]!;
  return stretches.filter(({ x0, x1 }) => x1 - x0 > LONGEST_PAUSE * usual);
}

/** Hatches the stretches of which nothing is known over the whole height. */
export function paintMissing(canvas: Canvas, map: PlotMap, stretches: readonly Stretch[]): void {
  const { context, palette, ratio } = canvas;
  context.fillStyle = palette.hatch(context, "missing", Math.round(6 * ratio));
  for (const stretch of stretches) {
    const left = leftColumn(map, stretch.x0);
    const width = Math.max(rightColumn(map, stretch.x1) - left, 2 * ratio);
    context.fillRect(left, 0, width, map.height);
  }
}

/** The columns [left, right) that [x0, x1] touches; of a reversed one, those that hold all of it. */
function columnsOf(map: PlotMap, x0: number, x1: number): [left: number, right: number] {
  const clamp = (column: number): number => Math.max(0, Math.min(map.width, column));
  return [clamp(leftColumn(map, x0)), clamp(rightColumn(map, x1))];
}

/**
 * Which pixel columns the segments touch, rounded outward. A certain one is so from its latest begin to its
 * earliest end; around that, as far as its ends may be wrong, it is possible.
 */
export function lanesOf(map: PlotMap, segments: readonly Segment[]): Lanes {
  const [certain, possible] = [new Uint8Array(map.width), new Uint8Array(map.width)];
  for (const { x0, x1, verdict, error } of segments) {
    if (verdict === "certain") certain.fill(1, ...columnsOf(map, x0 + error, x1 - error));
  }
  for (const { x0, x1, verdict, error } of segments) {
    const [left, right] = columnsOf(map, x0 - error, x1 + error);
    if (verdict === "possible") possible.fill(1, left, right);
    else for (let column = left; column < right; column += 1) possible[column]! |= 1 - certain[column]!;
  }
  return { certain, possible };
}

/** Calls for every run of touched columns. */
function eachRun(touched: Uint8Array, paint: (left: number, width: number) => void): void {
  for (let start = touched.indexOf(1); start >= 0; ) {
    const next = touched.indexOf(0, start);
    const stop = next < 0 ? touched.length : next;
    paint(start, stop - start);
    start = touched.indexOf(1, stop);
  }
}

/**
 * Paints the answers in two lanes at the bottom: certain as a solid bar, possible below it as a hatched
 * bar with an outline, each with a tint of the plot above.
 */
export function paintSegments(canvas: Canvas, map: PlotMap, segments: readonly Segment[]): void {
  const { context, palette, ratio } = canvas;
  const lane = Math.round(LANE_HEIGHT * ratio);
  const top = map.height - 2 * lane;
  const { certain, possible } = lanesOf(map, segments);
  eachRun(certain, (left, width) => {
    context.fillStyle = palette.colour("segment-certain");
    context.fillRect(left, 0, width, top);
    context.fillStyle = palette.colour("certain");
    context.fillRect(left, top, width, lane - ratio);
  });
  context.lineWidth = ratio;
  eachRun(possible, (left, width) => {
    context.fillStyle = palette.colour("segment-possible");
    context.fillRect(left, 0, width, top);
    context.fillStyle = palette.hatch(context, "possible", Math.round(5 * ratio));
    context.fillRect(left, top + lane, width, lane);
    context.strokeStyle = palette.colour("possible");
    context.strokeRect(left + ratio / 2, top + lane + ratio / 2, Math.max(ratio, width - ratio), lane - ratio);
  });
}

/** Draws the level that the question asks about. */
export function paintThreshold(canvas: Canvas, map: PlotMap, level: number): void {
  const { context, palette, ratio } = canvas;
  const y = Math.round(yPixel(map, level)) + 0.5;
  context.strokeStyle = palette.colour("threshold");
  context.lineWidth = ratio;
  context.setLineDash([8 * ratio, 3 * ratio, 2 * ratio, 3 * ratio]);
  context.beginPath();
  context.moveTo(0, y);
  context.lineTo(map.width, y);
  context.stroke();
  context.setLineDash([]);
}
