import uPlot from "uplot";
import type { Range } from "../state/window";
import type { Timeline } from "../time/timeline";
import { type Entries, leastSpacing, NOTHING } from "../tube/entries";
import { element, setText } from "../view/element";
import { AxisLabels, makeAxes, type Ticks } from "./axes";
import { BandPainter, type Canvas, halfMarkFor, reduceToColumns } from "./band";
import { DataAttributes } from "./data-attributes";
import { Gestures } from "./gestures";
import type { Palette } from "./palette";
import { paintPeaks, paintRegions, type PeakMark, PeakOverlay, type PlacedPeak, placePeaks } from "./peaks";
import type { PlotMap } from "./plot-map";
import { paintPredicted } from "./predicted";
import { type ChannelFacts, describeHull, nextKnown, readPeakText, readValue } from "./reading";
import {
  missingStretches, paintMissing, paintSegments, paintThreshold, type Segment, type Stretch, withoutPauses,
} from "./segments";
import { Tooltip } from "./tooltip";
import { calmRange, finiteExtentOf, type ValueRange } from "./value-range";
import type { PlotPlace } from "./verdict-strip";

export interface ChartOptions {
  readonly root: HTMLElement;
  readonly timeline: Timeline;
  readonly palette: Palette;
  readonly facts: ChannelFacts;
  /** A chart that stands alone: the wheel zooms at once, and its peaks are tab stops. */
  readonly alone: boolean;
  readonly dragPans: () => boolean;
  readonly onRange: (range: Range) => void;
  readonly onPeak: (mark: PeakMark) => void;
}

/** What a chart shows besides its band. */
export interface Marks {
  readonly peaks: readonly PeakMark[];
  readonly gaps: readonly Stretch[];
  readonly segments: readonly Segment[];
  readonly threshold: number | null;
  readonly predicted: Entries;
}

/** What questions about a channel were answered with. */
export type Answers = Omit<Marks, "peaks" | "gaps">;
export const NO_ANSWERS: Answers = { segments: [], threshold: null, predicted: NOTHING };

/** A chart of one channel's interval band: uPlot's scales and axes, with outward-rounding paint of ours. */
export class BandChart {
  facts: ChannelFacts;
  private readonly plot: uPlot;
  private readonly gestures: Gestures;
  private readonly overlay: PeakOverlay;
  private readonly tooltip: Tooltip;
  private readonly unitLabel = element("span", { class: "chart-unit", "aria-hidden": "true" });
  private readonly ticks: Ticks = { times: [], step: 1e9, values: [] };
  private readonly labels: AxisLabels;
  private readonly band = new BandPainter();
  private hovered = false;
  private readonly attributes: DataAttributes;
  private readonly resizing: ResizeObserver;
  private entries: Entries = NOTHING;
  private marks: Marks = { ...NO_ANSWERS, peaks: [], gaps: [] };
  private range: Range = { x0: 0, x1: 1e9 };
  private values: ValueRange | null = null;
  private placed: PlacedPeak[] = [];
  private pointer: { x: number; y: number } | null = null;
  private readonly host = element("div", { class: "chart-host" });

  constructor(private readonly options: ChartOptions) {
    const { root } = options;
    this.facts = options.facts;
    this.attributes = new DataAttributes(root, options.timeline);
    this.labels = new AxisLabels(options.timeline, (unit) => setText(this.unitLabel, unit));
    root.append(this.host, this.unitLabel);
    this.plot = new uPlot(this.plotOptions(), [[0], [null]], this.host);
    // What it shows has a name on the root, a value in the panel's head, and buttons over its peaks.
    this.plot.ctx.canvas.setAttribute("aria-hidden", "true");
    this.tooltip = new Tooltip(root, () => this.onLeave());
    this.gestures = new Gestures({
      area: this.plot.over,
      range: () => this.range,
      onRange: options.onRange,
      wheelZooms: () => options.alone || root.contains(document.activeElement),
      dragPans: options.dragPans,
    });
    this.overlay = new PeakOverlay({
      area: this.plot.over,
      tabStops: options.alone,
      describe: (mark) => {
        const text = readPeakText(mark, this.facts.unit);
        return [text.title, ...text.lines.map((line) => `${line.name} ${line.value}`)].join(", ");
      },
      onPoint: (placed) => this.pointAt(placed),
      onOpen: options.onPeak,
    });
    root.addEventListener("pointerenter", () => {
      this.hovered = true;
      this.overlay.sync(this.placed, uPlot.pxRatio);
    });
    root.addEventListener("pointerleave", () => {
      this.hovered = false;
    });
    this.plot.over.addEventListener("pointermove", this.onPointer);
    this.plot.over.addEventListener("pointerleave", this.onLeave);
    this.resizing = new ResizeObserver(() => this.resize());
    this.resizing.observe(this.host);
  }

  /** The width of the plot area in CSS pixels; it asks nothing of the page, which would lay it out anew. */
  get width(): number {
    return Math.max(1, this.plot.bbox.width / uPlot.pxRatio);
  }

  /** Where the plot lies; it asks nothing of the page, either. */
  get place(): PlotPlace {
    const { left, width } = this.plot.bbox;
    return { left: Math.round(left), width: Math.round(width), ratio: uPlot.pxRatio };
  }

  /** Whether the pointer or the focus is in the chart. */
  private get attended(): boolean {
    return this.hovered || this.options.root.contains(document.activeElement);
  }

  get busy(): boolean {
    return this.gestures.busy;
  }

  /**
   * Shows entries and marks over a window, and paints.
   *
   * @param settled whether what lies over the peaks is to be in its place, too; where the pointer or the focus is it
   * always follows. Each of these elements that moves has the page composed anew
   */
  show(entries: Entries, marks: Marks, range: Range, settled: boolean): void {
    this.entries = entries;
    this.marks = marks;
    this.range = range;
    this.values = calmRange(this.values, this.extent());
    const { min, max } = this.values;
    this.plot.batch(() => {
      this.plot.setScale("x", { min: range.x0, max: range.x1 });
      this.plot.setScale("y", { min, max });
    });
    if (settled || this.attended) this.overlay.sync(this.placed, uPlot.pxRatio);
    if (this.pointer) this.tip(this.pointer, false);
  }

  /** Forgets the scale of values, so that the next window chooses its own. */
  resetValues(): void {
    this.values = null;
  }

  /** Paints again, after a change of theme. */
  repaint(): void {
    this.plot.redraw(false, true);
  }

  /** Moves the reading cursor to the next entry, at least a pixel on, and reads its value out. */
  step(by: 1 | -1): void {
    const { x0, x1 } = this.range;
    const perPixel = (x1 - x0) / this.width;
    const from = this.pointer ? x0 + this.pointer.x * perPixel : (x0 + x1) / 2;
    const x = nextKnown(this.entries, from + by * perPixel, by);
    if (x === null || x < x0 || x > x1) return;
    this.pointer = { x: (x - x0) / perPixel, y: 8 };
    this.plot.setCursor({ left: this.pointer.x, top: 8 }, false);
    this.tip(this.pointer, true);
  }

  destroy(): void {
    this.resizing.disconnect();
    this.tooltip.hide();
    this.plot.destroy();
    this.options.root.replaceChildren();
  }

  private extent(): ValueRange | null {
    const { x0, x1 } = this.range;
    const extent = finiteExtentOf([this.entries, this.marks.predicted], x0, x1);
    const level = this.marks.threshold;
    if (extent === null) return level === null ? null : { min: level, max: level };
    const size = extent.max - extent.min;
    if (level === null || level > extent.max + 2 * size || level < extent.min - 2 * size) return extent;
    return { min: Math.min(extent.min, level), max: Math.max(extent.max, level) };
  }

  private plotOptions(): uPlot.Options {
    const { palette, timeline } = this.options;
    return {
      width: Math.max(120, this.host.clientWidth),
      height: Math.max(80, this.host.clientHeight),
      padding: [18, 6, 0, 0],
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, y: false, points: { show: false }, sync: { key: "eskin", scales: ["x", null] } },
      scales: { x: { time: false, auto: false }, y: { auto: false } },
      series: [{}, { paths: () => null, points: { show: false } }],
      axes: makeAxes({ palette, timeline, ticks: this.ticks }),
      hooks: { drawAxes: [(plot) => this.paint(plot)] },
    };
  }

  private plotMap(plot: uPlot, { min, max }: ValueRange): PlotMap {
    const { width, height } = plot.bbox;
    const { x0, x1 } = this.range;
    return { width: Math.round(width), height: Math.round(height), xMin: x0, xMax: x1, yMin: min, yMax: max };
  }

  private paint(plot: uPlot): void {
    // Before the first window is shown, the pixels have no values.
    if (this.values === null) return;
    const map = this.plotMap(plot, this.values);
    // Before the page is laid out, or in a window too small for its axes, there is nowhere to paint.
    if (map.width <= 0 || map.height <= 0) return;
    const ratio = uPlot.pxRatio;
    const canvas: Canvas = { context: plot.ctx, palette: this.options.palette, ratio };
    const { context } = canvas;
    const corner = { left: Math.round(plot.bbox.left), top: Math.round(plot.bbox.top) };
    context.save();
    context.translate(corner.left, corner.top);
    this.labels.paint(canvas, map, this.ticks, this.facts.unit);
    context.beginPath();
    context.rect(0, 0, map.width, map.height);
    context.clip();
    const { x0, x1 } = this.range;
    paintSegments(canvas, map, this.marks.segments);
    const missing = missingStretches(this.entries, x0, x1);
    paintMissing(canvas, map, [...(this.facts.bursts ? withoutPauses(missing) : missing), ...this.marks.gaps]);
    const spacing = (leastSpacing(this.entries) * map.width) / (x1 - x0);
    const style = { halfMark: halfMarkFor(spacing, ratio), thickness: Math.ceil(1.5 * ratio) };
    this.placed = placePeaks(this.marks.peaks, map, ratio);
    paintRegions(canvas, this.placed);
    paintPredicted(canvas, reduceToColumns(this.marks.predicted, map, style), map.height);
    this.band.paint(canvas, reduceToColumns(this.entries, map, style), map.height);
    if (this.marks.threshold !== null) paintThreshold(canvas, map, this.marks.threshold);
    paintPeaks(canvas, map, this.placed);
    context.restore();
    this.attributes.publish({ map, corner, ratio, entries: this.entries, predicted: this.marks.predicted });
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.host;
    if (clientWidth < 40 || clientHeight < 40) return;
    this.plot.batch(() => this.plot.setSize({ width: clientWidth, height: clientHeight }));
    // A history window is not painted again until it moves.
    this.overlay.sync(this.placed, uPlot.pxRatio);
  }

  private readonly onPointer = (event: PointerEvent): void => {
    if (event.target !== this.plot.over) return;
    const box = this.plot.over.getBoundingClientRect();
    this.pointer = { x: event.clientX - box.left, y: event.clientY - box.top };
    this.tip(this.pointer, false);
  };

  private readonly onLeave = (): void => {
    this.pointer = null;
    this.tooltip.hide();
  };

  private rootPoint(at: { x: number; y: number }): { x: number; y: number } {
    return { x: at.x + this.plot.bbox.left / uPlot.pxRatio, y: at.y + this.plot.bbox.top / uPlot.pxRatio };
  }

  private tip(at: { x: number; y: number }, speak: boolean): void {
    const perPixel = (this.range.x1 - this.range.x0) / this.width;
    const x = this.range.x0 + at.x * perPixel;
    const reading = readValue(this.entries, this.options.timeline, this.facts, { x, perPixel });
    if (reading === null) {
      this.tooltip.hide();
      return;
    }
    const { predicted } = this.marks;
    const value = describeHull(predicted, { x0: x - perPixel / 2, x1: x + perPixel / 2 }, this.facts.unit);
    const more = predicted.t.length > 0 ? [{ name: "predicted", value }] : [];
    this.tooltip.show({ ...reading.text, lines: [...reading.text.lines, ...more] }, this.rootPoint(at), speak);
  }

  private pointAt(placed: PlacedPeak | null): void {
    this.pointer = null;
    if (!placed) {
      this.tooltip.hide();
      return;
    }
    const ratio = uPlot.pxRatio;
    const at = { x: placed.tip.x / ratio, y: placed.tip.y / ratio };
    this.tooltip.show(readPeakText(placed.mark, this.facts.unit), this.rootPoint(at), false);
  }
}
