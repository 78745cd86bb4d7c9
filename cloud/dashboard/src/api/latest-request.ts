/** A question that takes longer is given up for a newer one. */
const PATIENCE_MS = 250;

export interface LatestRequestOptions {
  /** Asks, as things are by then; it takes its failures itself. */
  readonly ask: (signal: AbortSignal) => Promise<void>;
  /** Called when all is answered. */
  readonly onIdle: () => void;
  readonly now: () => number;
}

/**
 * Questions of which only the newest counts, as many as there are gestures: the first is asked at once, and
 * while it is answered the latest waits its turn.
 */
export class LatestRequest {
  private running: AbortController | null = null;
  private waiting = false;
  private since = -Infinity;

  constructor(private readonly options: LatestRequestOptions) {}

  /** Whether something is asked for. */
  get busy(): boolean {
    return this.running !== null;
  }

  ask(): void {
    this.waiting = true;
    if (this.running !== null && this.options.now() - this.since < PATIENCE_MS) return;
    this.running?.abort();
    void this.run();
  }

  /** Gives up what is under way. */
  stop(): void {
    this.waiting = false;
    this.running?.abort();
    this.running = null;
  }

  private async run(): Promise<void> {
    const running = new AbortController();
    this.running = running;
    while (this.waiting && this.running === running) {
      this.waiting = false;
      this.since = this.options.now();
      // One after the other: what the next one asks for depends on when it is asked.
      // oxlint-disable-next-line no-await-in-loop
      await this.options.ask(running.signal);
    }
    if (this.running !== running) return;
    this.running = null;
    this.options.onIdle();
  }
}
