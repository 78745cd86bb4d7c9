import uPlot from "uplot";
import { formatTicks } from "../interval/format";
import { tickLabel, tickPositions, tickStep } from "../time/ticks";
import type { Timeline } from "../time/timeline";
import type { Palette } from "./palette";

const FONT = "11px system-ui, -apple-system, 'Segoe UI', sans-serif";
const LABEL_WIDTH = 84;
/** A label so near to the right edge (CSS pixels) would be cut off. */
const EDGE = 24;

export interface AxesOptions {
  readonly palette: Palette;
  readonly timeline: Timeline;
  readonly unit: string;
  /** Called with the unit and prefix that the value axis is labelled in. */
  readonly onUnit: (unit: string) => void;
}

/** In CSS pixels, without having the page laid out. */
function widthOf(plot: uPlot): number {
  return Math.max(1, plot.bbox.width / uPlot.pxRatio);
}

function timeAxis(options: AxesOptions): uPlot.Axis {
  let step = 1e9;
  return {
    font: FONT,
    size: 24,
    gap: 4,
    stroke: () => options.palette.colour("axis"),
    grid: { stroke: () => options.palette.colour("grid"), width: 1 },
    ticks: { show: false },
    splits: (plot, _axis, min, max) => {
      step = tickStep(((max - min) * LABEL_WIDTH) / widthOf(plot));
      return tickPositions(options.timeline, min, max, step);
    },
    values: (plot, ticks) => {
      const { min, max } = plot.scales["x"] ?? {};
      const last = (max ?? 0) - (((max ?? 0) - (min ?? 0)) * EDGE) / widthOf(plot);
      return ticks.map((tick) => (tick > last ? "" : tickLabel(options.timeline, tick, step)));
    },
  };
}

function valueAxis(options: AxesOptions): uPlot.Axis {
  return {
    font: FONT,
    size: 50,
    gap: 4,
    space: 30,
    stroke: () => options.palette.colour("axis"),
    grid: { stroke: () => options.palette.colour("grid"), width: 1 },
    ticks: { show: false },
    values: (_plot, ticks) => {
      const { labels, unit } = formatTicks(ticks, options.unit);
      options.onUnit(unit);
      return labels;
    },
  };
}

/** The axes of a chart: local time below, values with one common prefix at the left. */
export function makeAxes(options: AxesOptions): uPlot.Axis[] {
  return [timeAxis(options), valueAxis(options)];
}
