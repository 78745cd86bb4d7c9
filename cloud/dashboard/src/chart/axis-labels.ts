import { formatTicks } from "../interval/format";
import { tickLabel } from "../time/ticks";
import type { Timeline } from "../time/timeline";
import type { Ticks } from "./axes";
import type { Canvas } from "./paint-band";
import { xPixel, yPixel, type PlotMap } from "./plot-map";
import { place, type Lettering } from "./stamps";

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
      const stamp = palette.stamps.stamp(this.times.get(tick) ?? "", lettering);
      place(context, stamp, x - stamp.width / 2, map.height + GAP * ratio + lettering.size / 2);
    }
    this.nameValues(ticks, code);
    for (const [index, tick] of ticks.values.entries()) {
      const stamp = palette.stamps.stamp(this.values[index] ?? "", lettering);
      place(context, stamp, -GAP * ratio - stamp.width, yPixel(map, tick));
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
