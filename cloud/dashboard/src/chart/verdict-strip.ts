import type { Range } from "../state/window";
import type { Timeline } from "../time/timeline";
import { element } from "../view/element";
import type { Palette } from "./palette";
import type { PlotMap } from "./plot-map";
import { Tooltip } from "./tooltip";
import { columnCodes, type ColumnRun, columnRuns, describeStretches, LOOKS, summarise, touching, type VerdictStretch } from "./verdict-stretches";

/** Where a plot lies beside the left edge of its chart, in device pixels, of which a CSS pixel has `ratio`. */
export interface PlotPlace {
  readonly left: number;
  readonly width: number;
  readonly ratio: number;
}

const HEIGHT = 14;
const KEYS = "Left and right arrows read the stretches.";

function legend(): HTMLElement {
  const keys = [["strip-certain", "certain"], ["strip-possible", "possible"], ["strip-impossible", "impossible"], ["missing", "samples missing"]] as const;
  return element("div", { class: "strip-legend" }, ...keys.map(([look, name]) => element("span", { class: "key" }, element("span", { class: `swatch ${look}`, "aria-hidden": "true" }), name)));
}

/** The verdicts of a formula under a chart, along the same time axis. */
export class VerdictStrip {
  /** Empty as long as there is no answer. */
  readonly root = element("div");
  private readonly strip = element("div", { class: "verdict-strip" });
  private readonly canvas = element("canvas", { "aria-hidden": "true" });
  private readonly picture = element("div", { class: "strip-picture", role: "img", tabindex: 0, "data-testid": "verdict-strip" }, this.canvas);
  private readonly tooltip: Tooltip;
  private stretches: readonly VerdictStretch[] = [];
  private map: PlotMap | null = null;
  private place: PlotPlace = { left: 0, width: 1, ratio: 1 };
  private runs: readonly ColumnRun[] = [];
  /** Where something is pointed at or read, as an instant of the time axis. */
  private at: number | null = null;

  constructor(private readonly timeline: Timeline, private readonly palette: Palette) {
    this.strip.append(this.picture, legend());
    this.tooltip = new Tooltip(this.strip, () => this.leave());
    this.picture.addEventListener("pointermove", (event) => this.point(event.clientX - this.picture.getBoundingClientRect().left));
    this.picture.addEventListener("pointerleave", () => this.leave());
    this.picture.addEventListener("blur", () => this.leave());
    this.picture.addEventListener("keydown", (event) => {
      if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
      event.preventDefault();
      this.step(event.key === "ArrowRight" ? 1 : -1);
    });
  }

  /** Takes the stretches of an answer, in order of time; an answer without any hides the strip. */
  take(stretches: readonly VerdictStretch[]): void {
    this.stretches = stretches;
    if (stretches.length === 0) {
      this.leave();
      this.strip.remove();
      // What is painted answers another question.
      this.map = null;
      this.canvas.width = 0;
      return;
    }
    if (this.root.childElementCount === 0) this.root.append(this.strip);
    this.picture.setAttribute("aria-label", `${summarise(stretches)} ${KEYS}`);
    this.repaint();
  }

  /** Paints over a window, below the plot of the chart that shows it. */
  show({ x0, x1 }: Range, place: PlotPlace): void {
    if (this.stretches.length === 0 || place.width <= 0) return;
    const { left, width, ratio } = place;
    if (left !== this.place.left || width !== this.place.width || ratio !== this.place.ratio || this.map === null) {
      this.place = place;
      this.canvas.width = width;
      this.canvas.height = Math.round(HEIGHT * ratio);
      this.picture.style.marginLeft = `${left / ratio}px`;
      this.picture.style.width = `${width / ratio}px`;
    }
    this.map = { width, height: this.canvas.height, xMin: x0, xMax: x1, yMin: 0, yMax: 1 };
    this.repaint();
    if (this.at !== null) this.tip(this.at, false);
  }

  /** Paints again, after a change of theme. */
  repaint(): void {
    const context = this.canvas.getContext("2d");
    if (this.map === null || context === null) return;
    const { timeline, map } = this;
    context.clearRect(0, 0, map.width, map.height);
    this.runs = columnRuns(columnCodes(map, this.stretches));
    for (const run of this.runs) this.paint(context, run);
    this.picture.dataset["start"] = timeline.toInstant(map.xMin).toString();
    this.picture.dataset["end"] = timeline.toInstant(map.xMax).toString();
  }

  private paint(context: CanvasRenderingContext2D, { left, right, code }: ColumnRun): void {
    const { palette, place: { ratio }, canvas: { height } } = this;
    const width = right - left;
    const look = LOOKS[code];
    if (look === "certain") {
      context.fillStyle = palette.colour("certain");
      context.fillRect(left, 0, width, height);
    } else if (look === "possible") {
      context.fillStyle = palette.hatch(context, "possible", Math.round(5 * ratio));
      context.fillRect(left, 0, width, height);
      // Lines at its sides would make a narrow one solid.
      const line = Math.max(1, Math.round(ratio));
      context.fillStyle = palette.colour("possible");
      for (const top of [0, height - line]) context.fillRect(left, top, width, line);
    } else if (look === "impossible") {
      const line = Math.round(3 * ratio);
      context.fillStyle = palette.colour("axis");
      context.fillRect(left, height - line, width, line);
    } else if (look === "missing") {
      context.fillStyle = palette.hatch(context, "missing", Math.round(6 * ratio));
      context.fillRect(left, 0, width, height);
    }
  }

  private leave(): void {
    this.at = null;
    this.tooltip.hide();
  }

  /** Points at a place, in CSS pixels from the picture's left edge. */
  private point(x: number): void {
    if (this.map === null) return;
    this.at = this.instant(Math.floor(x * this.place.ratio) + 0.5);
    this.tip(this.at, false);
  }

  /** Reads the next run of columns that look different, at its middle; but not the column in which two stretches meet. */
  private step(by: 1 | -1): void {
    if (this.map === null) return;
    const { map, stretches } = this;
    const runs = this.runs.filter(({ left, right, code }) => LOOKS[code] !== "none" && (right - left > 1 || touching(map, stretches, left).length !== 2));
    const here = this.at === null ? null : this.column(this.at);
    const later = (run: ColumnRun): boolean => here === null || run.left > here;
    const earlier = (run: ColumnRun): boolean => here === null || run.right <= here;
    const next = by > 0 ? runs.find(later) : runs.findLast(earlier);
    if (!next) return;
    this.at = this.instant((next.left + next.right) / 2);
    this.tip(this.at, true);
  }

  private instant(column: number): number {
    const { xMin, xMax, width } = this.map!;
    return xMin + ((xMax - xMin) * column) / width;
  }

  private column(x: number): number {
    const { xMin, xMax, width } = this.map!;
    return Math.floor(((x - xMin) / (xMax - xMin)) * width);
  }

  private tip(x: number, speak: boolean): void {
    const column = this.column(x);
    const answered = { x0: this.stretches[0]?.x0 ?? 0, x1: this.stretches.at(-1)?.x1 ?? 0 };
    const found = touching(this.map!, this.stretches, column);
    const text = describeStretches(found, answered);
    if (text === null) this.tooltip.hide();
    else this.tooltip.show(text, { x: (this.place.left + column) / this.place.ratio, y: HEIGHT }, speak);
  }
}
