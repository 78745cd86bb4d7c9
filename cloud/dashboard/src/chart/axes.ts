import uPlot from "uplot";
import { tickPositions, tickStep } from "../time/ticks";
import type { Timeline } from "../time/timeline";
import type { Palette } from "./palette";

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
  /** Where the axes leave their ticks, for whoever labels them. */
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
