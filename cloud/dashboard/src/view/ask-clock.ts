import type { View } from "../state/place";

const LIVE_PAUSE_MS = 2_000;
const SETTLE_MS = 200;

/** When a question is to be asked: once the window has settled, and every other second while it moves. */
export class AskClock {
  private askedAt = 0;
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
    const live = view.kind === "live" && at - this.askedAt > LIVE_PAUSE_MS;
    return live || (this.due !== null && at >= this.due);
  }

  /** It is asked now. */
  ask(at: number): void {
    this.due = null;
    this.askedAt = at;
  }
}
