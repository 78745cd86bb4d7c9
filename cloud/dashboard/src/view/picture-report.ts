/** Name of the measures of pictures; their detail is a `PictureDetail`. */
export const PICTURE = "eskin.picture";

/** What a script learns of a picture that was painted. */
export interface PictureDetail {
  readonly node: string;
  /** When the newest sample in it was taken at the earliest: UTC, ns since 1970. */
  readonly sample_ns: string;
  /** When the browser had painted it: UTC, ms since 1970. */
  readonly painted_ms: number;
}

/**
 * Reports pictures as `performance.measure` entries, for scripts with a `PerformanceObserver`. An entry lasts from the
 * begin of the picture's work to the instant at which the browser has handed the frame on. No entry is kept after
 * observers have it.
 */
export class PictureReport {
  private readonly channel = new MessageChannel();
  private pending: { readonly begin: number; readonly node: string; readonly sample: bigint }[] = [];

  constructor() {
    this.channel.port1.addEventListener("message", () => this.write());
    this.channel.port1.start();
  }

  /** Takes note of a picture that was drawn in this animation frame; its work began at a time of the page's clock (ms). */
  drawn(node: string, sample: bigint, begin: number): void {
    this.pending.push({ begin, node, sample });
    // A message that is posted in an animation frame comes when the browser has painted that frame.
    if (this.pending.length === 1) this.channel.port2.postMessage(null);
  }

  destroy(): void {
    this.channel.port1.close();
  }

  private write(): void {
    const painted_ms = performance.timeOrigin + performance.now();
    for (const { begin, node, sample } of this.pending) {
      const detail: PictureDetail = { node, sample_ns: String(sample), painted_ms };
      performance.measure(PICTURE, { start: begin, end: performance.now(), detail });
    }
    performance.clearMeasures(PICTURE);
    this.pending = [];
  }
}
