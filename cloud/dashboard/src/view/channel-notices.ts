import { ApiError, messageOf } from "../api/error";
import { type Instant, printClock, printDay } from "../time/instant";
import { element } from "./element";
import { NoticeBoard } from "./notice";

const RETRY_MS = 5_000;

/** Whether a retry may succeed: the cloud is unreachable, busy or failing, and the request is valid. */
function mayPass(error: unknown): boolean {
  return !(error instanceof ApiError) || error.status === null || error.status === 429 || error.status >= 500;
}

/**
 * Notices over a channel's chart. "Loading" and failures stay until the requested data has arrived, whatever else
 * arrives meanwhile.
 */
export class ChannelNotices {
  private readonly board = new NoticeBoard(element("div", { class: "overlay" }));
  private state: "unasked" | "loading" | "failed" | "empty" | "shown" = "unasked";
  private retryAt = Infinity;

  get root(): HTMLElement {
    return this.board.root;
  }

  /** Something is asked for of which nothing is shown yet. */
  loading(): void {
    this.become("loading");
    this.board.show("loading", "Loading…", "");
  }

  /** Something else is asked for; what is shown stays for so long. */
  asking(): void {
    if (this.state === "shown") this.board.clear();
    else this.loading();
  }

  /** What was asked for is there. */
  shown(): void {
    this.become("shown");
    this.board.clear();
  }

  /** Live samples came in. Only `silent` removes a notice of silence: these may be as late as those before. */
  arrived(): void {
    if (this.state === "empty") this.shown();
  }

  /** The channel has no data at all. */
  noData(channel: string): void {
    this.become("empty");
    this.board.show("empty", "No data yet", `${channel} has not sent data yet. It appears here with its first frame.`);
  }

  /** The channel has data, though not in this window. */
  noSamples(showAll: () => void): void {
    this.become("empty");
    this.board.show("empty", "No samples in this window", "", { label: "Show all data", act: showAll });
  }

  /** Shows since when no data has arrived; null while it arrives. */
  silent(since: Instant | null): void {
    if (this.state !== "shown") return;
    if (since === null) {
      this.board.clear();
      return;
    }
    const day = printDay(since);
    const today = printDay(BigInt(Date.now()) * 1_000_000n);
    this.board.show("stale", `No data after ${day === today ? "" : `${day} `}${printClock(since, 0)}`, "");
  }

  /** The request failed. */
  fail(error: unknown, again: () => void): void {
    this.become("failed");
    if (mayPass(error)) this.retryAt = performance.now() + RETRY_MS;
    const act = (): void => {
      this.loading();
      again();
    };
    this.board.show("error", "This channel could not be loaded", messageOf(error), { label: "Try again", act });
  }

  /** Whether to retry now; true once for each failure. */
  retryDue(at: number): boolean {
    if (at < this.retryAt) return false;
    this.retryAt = Infinity;
    return true;
  }

  private become(state: "loading" | "failed" | "empty" | "shown"): void {
    this.state = state;
    this.retryAt = Infinity;
  }
}
