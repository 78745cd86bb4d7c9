const CALM_FRAME_MS = 500;
/** What paints may take at most this share of the time: the browser takes as much again to bring it to the screen. */
const SHARE = 0.3;
/** Over so many frames: one that writes texts, too, takes longer than the others, and is no reason to leave one out. */
const FRAMES = 12;

/** Calls for a frame as often as the screen shows one, and less often when painting is slow. */
export class FrameLoop {
  private next = 0;
  private cost = 0;
  private handle = 0;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");

  constructor(private readonly onFrame: (at: number) => void) {}

  start(): void {
    this.handle = requestAnimationFrame(this.tick);
  }

  stop(): void {
    cancelAnimationFrame(this.handle);
  }

  private readonly tick = (at: number): void => {
    this.handle = requestAnimationFrame(this.tick);
    if (at < this.next) return;
    const begin = performance.now();
    // The frame's own time is even, whenever in it we come to paint: so the picture moves evenly, too.
    this.onFrame(at);
    this.cost += (performance.now() - begin - this.cost) / FRAMES;
    this.next = at - 4 + Math.max(this.calm.matches ? CALM_FRAME_MS : 0, this.cost / SHARE);
  };
}
