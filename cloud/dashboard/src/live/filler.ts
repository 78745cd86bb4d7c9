import type { Range } from "../state/window";
import type { ChannelData } from "./channel-data";
import type { LiveEdge } from "./edge";

export interface FillerOptions {
  readonly data: ChannelData;
  readonly edge: LiveEdge;
  /** How many pixels a window is wide. */
  readonly width: () => number;
  readonly onFilled: () => void;
  readonly onFailure: (error: unknown) => void;
}

/** Fills a channel's live window from the store. */
export class Filler {
  private asking = new AbortController();

  constructor(private readonly options: FillerOptions) {}

  /** Fills a stretch, as far as a window of `span` ns shows it. */
  fillHole(stretch: Range, span: number): void {
    const { data, edge, width, onFilled, onFailure } = this.options;
    const range = { x0: Math.max(stretch.x0, stretch.x1 - span), x1: stretch.x1 };
    const points = Math.max(2, Math.ceil((width() * (range.x1 - range.x0)) / span));
    data.backfill(range, points, this.asking.signal).then(() => {
      edge.observe(range.x1, performance.now());
      onFilled();
    }, onFailure);
  }

  /** Fills a whole window that ends with what is known. */
  fillWindow(span: number): void {
    const { end } = this.options.data;
    if (end !== null) this.fillHole({ x0: end - span, x1: end }, span);
  }

  /** Gives up what is under way. */
  stop(): void {
    this.asking.abort();
    this.asking = new AbortController();
  }
}
