import { formatCount } from "../interval/format";
import type { Canvas } from "./paint-band";
import { groupPeaks, type PeakMark } from "./peak-groups";
import { place, type Lettering } from "./stamps";
import { enclosingBox, type PixelBox, type PlotMap } from "./plot-map";

/** Where a peak was painted, for the elements that make it reachable by mouse and keyboard. */
export interface PlacedPeak {
  readonly mark: PeakMark;
  readonly box: PixelBox;
  /** The point of its triangle in device pixels. */
  readonly tip: { readonly x: number; readonly y: number };
}

const LEAST_BOX = 4;
/** Peaks nearer to each other than this (CSS pixels) become a group. */
const CLOSE = 9;
const HALF_TRIANGLE = 5;
const TRIANGLE_HEIGHT = 8;
const LIFT = 3;

/** Places the peaks that a window shows, in the order of time; those too close to tell apart are grouped. */
export function placePeaks(peaks: readonly PeakMark[], map: PlotMap, ratio: number): PlacedPeak[] {
  const placed: PlacedPeak[] = [];
  const reach = (CLOSE * ratio * (map.xMax - map.xMin)) / map.width;
  const inOrder = peaks.toSorted((one, other) => one.x0 - other.x0);
  for (const mark of groupPeaks(inOrder, reach)) {
    if (mark.x1 < map.xMin || mark.x0 > map.xMax) continue;
    const box = enclosingBox(map, mark, LEAST_BOX * ratio);
    const room = (TRIANGLE_HEIGHT + 1) * ratio;
    const x = Math.max(0, Math.min(map.width, (box.left + box.right) / 2));
    placed.push({ mark, box, tip: { x, y: Math.max(room, box.top - LIFT * ratio) } });
  }
  return placed;
}

function trianglePath(tip: { x: number; y: number }, ratio: number): Path2D {
  const path = new Path2D();
  path.moveTo(tip.x, tip.y);
  path.lineTo(tip.x - HALF_TRIANGLE * ratio, tip.y - TRIANGLE_HEIGHT * ratio);
  path.lineTo(tip.x + HALF_TRIANGLE * ratio, tip.y - TRIANGLE_HEIGHT * ratio);
  path.closePath();
  return path;
}

function paintRegion(canvas: Canvas, placed: PlacedPeak): void {
  const { context, palette, ratio } = canvas;
  const { box } = placed;
  const certain = placed.mark.verdict === "certain";
  context.lineWidth = 1.5 * ratio;
  context.strokeStyle = palette.colour(certain ? "certain" : "possible");
  context.setLineDash(certain ? [] : [3 * ratio, 2.5 * ratio]);
  if (certain) {
    context.fillStyle = palette.colour("certain-fill");
    context.fillRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  }
  context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.setLineDash([]);
}

function paintTriangle(canvas: Canvas, placed: PlacedPeak): void {
  const { context, palette, ratio } = canvas;
  const certain = placed.mark.verdict === "certain";
  const path = trianglePath(placed.tip, ratio);
  context.lineWidth = 1.5 * ratio;
  context.lineJoin = "round";
  context.fillStyle = palette.colour(certain ? "certain" : "plot");
  context.fill(path);
  context.strokeStyle = palette.colour(certain ? "certain" : "possible");
  context.stroke(path);
}

/**
 * Paints where peaks lie: a certain one in a solid box, a possible one in a dashed box. It comes before the
 * band, which no mark may hide.
 */
export function paintRegions(canvas: Canvas, placed: readonly PlacedPeak[]): void {
  for (const peak of placed) {
    if (peak.mark.events === 1) paintRegion(canvas, peak);
  }
}

/**
 * Paints peaks: a certain one as a filled triangle, a possible one as a hollow triangle with its count.
 * Counts are left out where they would overlap.
 */
export function paintPeaks(canvas: Canvas, map: PlotMap, placed: readonly PlacedPeak[]): void {
  const { context, palette, ratio } = canvas;
  const lettering: Lettering = { size: Math.round(10 * ratio), weight: 600, colour: palette.colour("text"), halo: palette.colour("plot") };
  for (const [index, peak] of placed.entries()) {
    paintTriangle(canvas, peak);
    const count = formatCount(peak.mark.count);
    const text = { x: peak.tip.x + (HALF_TRIANGLE + 3) * ratio, y: peak.tip.y - (TRIANGLE_HEIGHT / 2) * ratio };
    const next = (placed[index + 1]?.tip.x ?? map.width) - HALF_TRIANGLE * ratio;
    if (count === "1") continue;
    const stamp = palette.stamps.stamp(count, lettering);
    if (text.x + stamp.width <= next) place(context, stamp, text.x, text.y);
  }
}
