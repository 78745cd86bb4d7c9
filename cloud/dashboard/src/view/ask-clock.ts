import type { View } from "../state/place";

const LIVE_PAUSE_MS = 2_000;
const SETTLE_MS = 200;
/** An answer that takes longer will not come any more. */
const PATIENCE_MS = 30_000;

/**
 * When a question is to be asked: once the window has settled, and every other second while it moves; but what was
 * asked is answered first, or a slow cloud would never come to answer.
 */
export class AskClock {
  private askedAt = 0;
  private waiting = false;
  private due: number | null = null;

  /** The window or the question has changed: ask once no more changes come. */
  settle(): void {
    this.due = performance.now() + SETTLE_MS;
  }

  /** Nothing is asked any more. */
  stop(): void {
    this.due = null;
  }

  isDue(at: number, view: View): boolean {
    const live = view.kind === "live" && at - this.askedAt > (this.waiting ? PATIENCE_MS : LIVE_PAUSE_MS);
    return live || (this.due !== null && at >= this.due);
  }

  /** It is asked now. */
  ask(at: number): void {
    this.due = null;
    this.askedAt = at;
    this.waiting = true;
  }

  /** What was asked last is answered, or given up. */
  answered(): void {
    this.waiting = false;
  }
}
