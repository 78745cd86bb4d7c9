const CALM_FRAME_MS = 500;
/** What paints may take at most this share of the time: the browser takes as much again to bring it to the screen. */
const SHARE = 0.3;
/** Over so many frames: one that writes texts, too, takes longer than the others, and is no reason to leave one out. */
const FRAMES = 12;
/** A browser that lets a frame wait longer than this cannot keep the screen's pace of 60 frames a second. */
const LATE_MS = 21;
/** Then it is asked for 35 frames a second, which leaves time to others on a machine that is busy. */
const EASED_MS = 28.5;
/** After so long with fewer frames all are tried again, for so long. */
const EASED_FOR_MS = 20_000;
const TRIED_FOR_MS = 2_000;
/** A frame that is due later than this is asked for later: one that shows nothing new costs the browser time, too. */
const SOON_MS = 12;

/** Calls for a frame as often as the screen shows one, and less often when painting is slow or the machine is busy. */
export class FrameLoop {
  private next = 0;
  private cost = 0;
  private handle = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private eased = false;
  private asked = 0;
  /** Since when the browser's pace is counted, how long frames waited, and how many. */
  private since = 0;
  private waited = 0;
  private count = 0;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");

  constructor(private readonly onFrame: (at: number) => void) {}

  start(): void {
    this.ask();
  }

  stop(): void {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.handle);
  }

  private readonly ask = (): void => {
    this.asked = performance.now();
    this.handle = requestAnimationFrame(this.tick);
  };

  private readonly tick = (at: number): void => {
    const begin = performance.now();
    this.judge(begin);
    if (at >= this.next) {
      // The frame's own time is even, whenever in it we come to paint: so the picture moves evenly, too.
      this.onFrame(at);
      this.cost += (performance.now() - begin - this.cost) / FRAMES;
      const least = at - 4 + Math.max(this.calm.matches ? CALM_FRAME_MS : 0, this.cost / SHARE);
      // Counted from when this frame was due: so frames of the screen that come between make none too many or too few.
      this.next = Math.max(least, this.eased ? Math.max(this.next, at - EASED_MS) + EASED_MS : 0);
    }
    const rest = this.next - performance.now();
    if (rest > SOON_MS) this.timer = setTimeout(this.ask, rest - SOON_MS);
    else this.ask();
  };

  /** Whether the browser keeps the screen's pace; asked anew from time to time. */
  private judge(now: number): void {
    this.waited += now - this.asked;
    this.count += 1;
    if (now - this.since < (this.eased ? EASED_FOR_MS : TRIED_FOR_MS)) return;
    this.eased = !this.eased && this.waited / this.count > LATE_MS;
    this.since = now;
    this.waited = this.count = 0;
  }
}
