import uPlot from "uplot";
import { formatTicks } from "../interval/format";
import { tickLabel, tickPositions, tickStep } from "../time/ticks";
import type { Timeline } from "../time/timeline";
import type { Canvas } from "./band";
import type { Palette } from "./palette";
import { type PlotMap, xPixel, yPixel } from "./plot-map";
import { drawText, type Lettering } from "./text-cache";

const LABEL_WIDTH = 84;

/** The ticks that the axes have chosen for what is shown. */
export interface Ticks {
  times: readonly number[];
  /** Between times, in ns. */
  step: number;
  values: readonly number[];
}

export interface AxesOptions {
  readonly palette: Palette;
  readonly timeline: Timeline;
  /** The axes write their ticks here, for the labels. */
  readonly ticks: Ticks;
}

/** In CSS pixels, without having the page laid out. */
function widthOf(plot: uPlot): number {
  return Math.max(1, plot.bbox.width / uPlot.pxRatio);
}

/** Grid lines at local times and at values, with room for their labels below and at the left. */
export function makeAxes({ palette, timeline, ticks }: AxesOptions): uPlot.Axis[] {
  const both: uPlot.Axis = { grid: { stroke: () => palette.colour("grid"), width: 1 }, ticks: { show: false } };
  const time: uPlot.Axis = {
    ...both,
    size: 24,
    splits: (plot, _axis, min, max) => {
      ticks.step = tickStep(((max - min) * LABEL_WIDTH) / widthOf(plot));
      return tickPositions(timeline, min, max, ticks.step);
    },
    values: (_plot, splits) => {
      ticks.times = splits;
      return splits.map(() => null);
    },
  };
  const value: uPlot.Axis = {
    ...both,
    size: 50,
    space: 30,
    values: (_plot, splits) => {
      ticks.values = splits;
      return splits.map(() => null);
    },
  };
  return [time, value];
}

const SIZE = 11;
const GAP = 4;
/** A label so near to the right edge (CSS pixels) would be cut off. */
const EDGE = 24;

/** The labels of both axes; each is made once, as long as its tick is there. */
export class AxisLabels {
  private readonly times = new Map<number, string>();
  private step = 0;
  private written = "";
  private values: readonly string[] = [];

  constructor(
    private readonly timeline: Timeline,
    private readonly onUnit: (unit: string) => void,
  ) {}

  /**
   * Paints the labels around a plot.
   *
   * @param canvas with the plot's corner at (0, 0)
   * @param code of the values' unit (UCUM)
   */
  paint(canvas: Canvas, map: PlotMap, ticks: Ticks, code: string): void {
    const { context, palette, ratio } = canvas;
    const lettering: Lettering = { size: Math.round(SIZE * ratio), weight: 400, colour: palette.colour("axis"), halo: null };
    this.nameTimes(ticks);
    for (const tick of ticks.times) {
      const x = xPixel(map, tick);
      if (x > map.width - EDGE * ratio) continue;
      const label = palette.texts.get(this.times.get(tick) ?? "", lettering);
      drawText(context, label, x - label.width / 2, map.height + GAP * ratio + lettering.size / 2);
    }
    this.nameValues(ticks, code);
    for (const [index, tick] of ticks.values.entries()) {
      const label = palette.texts.get(this.values[index] ?? "", lettering);
      drawText(context, label, -GAP * ratio - label.width, yPixel(map, tick));
    }
  }

  private nameTimes({ times, step }: Ticks): void {
    if (step !== this.step) this.times.clear();
    this.step = step;
    const shown = new Set(times);
    for (const tick of this.times.keys()) if (!shown.has(tick)) this.times.delete(tick);
    for (const tick of times) if (!this.times.has(tick)) this.times.set(tick, tickLabel(this.timeline, tick, step));
  }

  private nameValues({ values }: Ticks, code: string): void {
    const state = `${code} ${values.join()}`;
    if (state === this.written) return;
    this.written = state;
    const { labels, unit } = formatTicks(values, code);
    this.values = labels;
    this.onUnit(unit);
  }
}
