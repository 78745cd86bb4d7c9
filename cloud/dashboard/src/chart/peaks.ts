import type { EventItem, Verdict } from "../api/contract";
import { formatCount } from "../interval/format";
import { type Interval, readInterval } from "../interval/interval";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { button } from "../view/element";
import type { Canvas } from "./band";
import { enclosingBox, type PixelBox, type PlotMap } from "./plot-map";
import { drawText, type Lettering } from "./text-cache";

/** A peak as a region of the plot: when and how high it is, as intervals; or several that lie too close. */
export interface PeakMark {
  readonly event: EventItem;
  readonly verdict: Verdict;
  readonly x0: number;
  readonly x1: number;
  readonly lo: number;
  readonly hi: number;
  /** How many peaks it stands for. */
  readonly count: Interval;
  /** How many events it stands for: 1, or more for a group. */
  readonly events: number;
}

/** Reads a peak of the event list; null for other events. */
export function readPeak(event: EventItem, timeline: Timeline): PeakMark | null {
  if (event.kind !== "peak" || event.verdict === null) return null;
  const height = event.height ? readInterval(event.height) : { lo: -Infinity, hi: Infinity };
  const usual = { lo: event.verdict === "certain" ? 1 : 0, hi: 1 };
  return {
    event,
    verdict: event.verdict,
    x0: timeline.toX(parseInstant(event.time.lo)),
    x1: timeline.toX(parseInstant(event.time.hi)),
    ...height,
    count: event.count ? readInterval(event.count) : usual,
    events: 1,
  };
}

function join(one: PeakMark, other: PeakMark): PeakMark {
  return {
    event: one.event,
    verdict: one.verdict === "certain" || other.verdict === "certain" ? "certain" : "possible",
    x0: Math.min(one.x0, other.x0),
    x1: Math.max(one.x1, other.x1),
    lo: Math.min(one.lo, other.lo),
    hi: Math.max(one.hi, other.hi),
    count: { lo: one.count.lo + other.count.lo, hi: one.count.hi + other.count.hi },
    events: one.events + other.events,
  };
}

/**
 * Joins peaks that begin within `reach` ns of a group's first. Counts add as intervals: a certain peak
 * and one that is possible up to three times are 1–4 peaks, of which at least one is certain.
 *
 * @param marks in the order of time
 */
export function groupPeaks(marks: readonly PeakMark[], reach: number): PeakMark[] {
  const groups: PeakMark[] = [];
  for (const mark of marks) {
    const last = groups.at(-1);
    if (last && mark.x0 - last.x0 < reach) groups[groups.length - 1] = join(last, mark);
    else groups.push(mark);
  }
  return groups;
}

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

/** Places the peaks that a window shows, in the order of time; those too close together are grouped. */
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
    const label = palette.texts.get(count, lettering);
    if (text.x + label.width <= next) drawText(context, label, text.x, text.y);
  }
}

export interface OverlayOptions {
  readonly area: HTMLElement;
  /** Whether each peak is a tab stop of its own. */
  readonly tabStops: boolean;
  readonly describe: (mark: PeakMark) => string;
  readonly onPoint: (placed: PlacedPeak | null) => void;
  readonly onOpen: (mark: PeakMark) => void;
}

/** A chart shows at most so many reachable peaks, the latest ones; all are painted. */
const MOST = 60;

/** Elements over the painted peaks, so that mouse, keyboard and screen reader reach them. */
export class PeakOverlay {
  private readonly shown = new Map<string, { placed: PlacedPeak; hit: HTMLButtonElement }>();

  constructor(private readonly options: OverlayOptions) {}

  /** Moves the elements to where the peaks were painted. */
  sync(placed: readonly PlacedPeak[], ratio: number): void {
    const current = new Set<string>();
    for (const peak of placed.slice(-MOST)) {
      const { id } = peak.mark.event;
      current.add(id);
      const entry = this.shown.get(id) ?? this.add(peak);
      if (entry.placed.mark.events !== peak.mark.events) this.describe(entry.hit, peak.mark);
      entry.placed = peak;
      const x = Math.round(peak.tip.x / ratio) - 8;
      const y = Math.round(peak.tip.y / ratio) - 12;
      entry.hit.style.transform = `translate(${x}px, ${y}px)`;
    }
    for (const [id, { hit }] of this.shown) {
      if (current.has(id)) continue;
      hit.remove();
      this.shown.delete(id);
    }
  }

  private add(peak: PlacedPeak): { placed: PlacedPeak; hit: HTMLButtonElement } {
    const { mark } = peak;
    const attributes = {
      class: "peak-hit",
      "data-testid": "peak",
      "data-event-id": mark.event.id,
      tabindex: this.options.tabStops ? 0 : -1,
    };
    const hit = button("", attributes, () => this.options.onOpen(entry.placed.mark));
    this.describe(hit, mark);
    const entry = { placed: peak, hit };
    for (const type of ["pointerenter", "focus"]) {
      hit.addEventListener(type, () => this.options.onPoint(entry.placed));
    }
    for (const type of ["pointerleave", "blur"]) hit.addEventListener(type, () => this.options.onPoint(null));
    this.shown.set(mark.event.id, entry);
    this.options.area.append(hit);
    return entry;
  }

  private describe(hit: HTMLButtonElement, mark: PeakMark): void {
    hit.dataset["verdict"] = mark.verdict;
    hit.dataset["count"] = formatCount(mark.count);
    hit.dataset["events"] = String(mark.events);
    hit.setAttribute("aria-label", this.options.describe(mark));
  }
}
