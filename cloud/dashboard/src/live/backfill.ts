import type { Range } from "../state/window";
import type { ChannelData } from "./channel-data";
import type { LiveEdge } from "./edge";

export interface BackfillOptions {
  readonly data: ChannelData;
  readonly edge: LiveEdge;
  /** How many pixels a window is wide. */
  readonly width: () => number;
  readonly onFilled: () => void;
  readonly onFailure: (error: unknown) => void;
}

/** Fills a channel's live window from the store. After a failure, only the whole of it. */
export class Backfill {
  private asking = new AbortController();
  private failed = false;

  constructor(private readonly options: BackfillOptions) {}

  /** Fills a stretch, as far as a window of `span` ns shows it. */
  fillHole(stretch: Range, span: number): void {
    if (!this.failed) this.load({ x0: Math.max(stretch.x0, stretch.x1 - span), x1: stretch.x1 }, span);
  }

  /** Fills a whole window that ends with what is known. */
  fillWindow(span: number): void {
    this.stop();
    const tail = this.options.data.tail(span);
    if (tail !== null) this.load(tail, span);
  }

  /** Aborts running requests. */
  stop(): void {
    this.asking.abort();
    this.asking = new AbortController();
    this.failed = false;
  }

  private load(range: Range, span: number): void {
    const { data, edge, width, onFilled } = this.options;
    const { signal } = this.asking;
    const points = Math.max(2, Math.ceil((width() * (range.x1 - range.x0)) / span));
    data.backfill(range, points, signal).then(() => {
      if (signal.aborted) return;
      edge.observe(Math.min(range.x1, data.end ?? range.x1), performance.now());
      onFilled();
    }, (error: unknown) => {
      if (!signal.aborted) this.fail(error);
    });
  }

  /** Other requests must not report the window as complete. */
  private fail(error: unknown): void {
    this.stop();
    this.failed = true;
    this.options.onFailure(error);
  }
}
