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

/** Publishes which values a chart's pixels stand for, as data attributes of its root. */
export class DataAttributes {
  private readonly written = new Map<string, string>();

  constructor(private readonly root: HTMLElement, private readonly timeline: Timeline) {}

  publish({ map, corner, ratio, entries, predicted }: Painted): void {
    const { timeline } = this;
    const end = endOf(entries);
    this.set("xMin", timeline.toInstant(map.xMin).toString());
    this.set("xMax", timeline.toInstant(map.xMax).toString());
    this.set("yMin", String(map.yMin));
    this.set("yMax", String(map.yMax));
    this.set("plotLeft", String(corner.left / ratio));
    this.set("plotTop", String(corner.top / ratio));
    this.set("plotWidth", String(map.width / ratio));
    this.set("plotHeight", String(map.height / ratio));
    this.set("pixelRatio", String(ratio));
    this.set("entries", String(countWithin(entries, map)));
    this.set("predicted", String(predicted.t.length));
    this.set("newest", end === null ? "" : timeline.toInstant(Math.min(end, map.xMax)).toString());
  }

  /** Writes an attribute where it differs. */
  private set(name: string, text: string): void {
    if (this.written.get(name) === text) return;
    this.written.set(name, text);
    this.root.dataset[name] = text;
  }
}
