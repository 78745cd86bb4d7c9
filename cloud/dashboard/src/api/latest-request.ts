/** A request that takes longer is aborted for a newer one. */
const PATIENCE_MS = 250;

export interface LatestRequestOptions {
  /** Sends the request; handles its own failures. */
  readonly ask: (signal: AbortSignal) => Promise<void>;
  /** Called when no request is left. */
  readonly onIdle: () => void;
  readonly now: () => number;
}

/**
 * Sends only the newest of many requests, such as those of a gesture: the first goes at once, and the newest of the
 * others follows when it is answered.
 */
export class LatestRequest {
  private running: AbortController | null = null;
  private waiting = false;
  private since = -Infinity;

  constructor(private readonly options: LatestRequestOptions) {}

  /** Whether a request is running. */
  get busy(): boolean {
    return this.running !== null;
  }

  ask(): void {
    this.waiting = true;
    if (this.running !== null && this.options.now() - this.since < PATIENCE_MS) return;
    this.running?.abort();
    void this.run();
  }

  /** Aborts the running request. */
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
