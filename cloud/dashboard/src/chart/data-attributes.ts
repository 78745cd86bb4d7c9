import type { Timeline } from "../time/timeline";
import { endOf, type Entries, firstAtOrAfter, firstReaching } from "../tube/entries";
import type { PlotMap } from "./plot-map";

/** What was painted where. The corner is in device pixels of the root, of which a CSS pixel has `ratio`. */
export interface Painted {
  readonly map: PlotMap;
  readonly corner: { readonly left: number; readonly top: number };
  readonly ratio: number;
  readonly entries: Entries;
  readonly predicted: Entries;
}

/** How many entries touch a window; more may be held. */
function countWithin(entries: Entries, { xMin, xMax }: PlotMap): number {
  return Math.max(0, firstAtOrAfter(entries.t, xMax) - firstReaching(entries, xMin));
}

/** Tells tests and tools, by attributes of a chart's root, which values its pixels stand for. */
export class DataAttributes {
  private readonly said = new Map<string, string>();

  constructor(private readonly root: HTMLElement, private readonly timeline: Timeline) {}

  publish({ map, corner, ratio, entries, predicted }: Painted): void {
    const { timeline } = this;
    const end = endOf(entries);
    this.say("xMin", timeline.toInstant(map.xMin).toString());
    this.say("xMax", timeline.toInstant(map.xMax).toString());
    this.say("yMin", String(map.yMin));
    this.say("yMax", String(map.yMax));
    this.say("plotLeft", String(corner.left / ratio));
    this.say("plotTop", String(corner.top / ratio));
    this.say("plotWidth", String(map.width / ratio));
    this.say("plotHeight", String(map.height / ratio));
    this.say("pixelRatio", String(ratio));
    this.say("entries", String(countWithin(entries, map)));
    this.say("predicted", String(predicted.t.length));
    this.say("newest", end === null ? "" : timeline.toInstant(Math.min(end, map.xMax)).toString());
  }

  /** Most stay as they are from picture to picture. */
  private say(name: string, text: string): void {
    if (this.said.get(name) === text) return;
    this.said.set(name, text);
    this.root.dataset[name] = text;
  }
}
