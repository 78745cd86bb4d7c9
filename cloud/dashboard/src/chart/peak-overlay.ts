import { button } from "../view/element";
import { formatCount } from "../interval/format";
import type { PeakMark } from "./peak-groups";
import type { PlacedPeak } from "./peaks";

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
