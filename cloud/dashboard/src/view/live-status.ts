import type { FeedState } from "../live/frame-feed";
import { element, setText } from "./element";

/** Says in words and by shape whether live data flows; changes are read out. */
export class LiveStatus {
  readonly root: HTMLElement;
  private readonly text = element("span", { role: "status", "aria-live": "polite" });
  private readonly dot = element("i", { class: "dot" });
  private state: FeedState = { kind: "connecting" };
  private refused = 0;
  private reachable = true;

  constructor() {
    this.root = element("span", { class: "live-status", "data-testid": "live-status" }, this.dot, this.text);
    this.show(this.state);
  }

  show(state: FeedState): void {
    this.state = state;
    this.write();
  }

  /** Takes over whether the cloud answers: a stream from one that does not is open for a while, and silent. */
  reach(reachable: boolean): void {
    if (reachable === this.reachable) return;
    this.reachable = reachable;
    this.write();
  }

  /** Counts a live message that could not be read: nothing vanishes silently. */
  refuse(): void {
    this.refused += 1;
    this.write();
  }

  private write(): void {
    const { state } = this;
    const silent = state.kind === "open" && !this.reachable;
    this.root.dataset["state"] = silent ? "waiting" : state.kind;
    this.root.title = state.kind === "waiting" ? state.reason : "";
    const words = {
      connecting: "Connecting…",
      open: silent ? "The cloud does not answer" : "Receiving",
      waiting: `Reconnecting in ${state.kind === "waiting" ? state.seconds : 0} s`,
      offline: "No network: check the connection",
    }[state.kind];
    setText(this.text, this.refused > 0 ? `${words} · ${this.refused} unreadable` : words);
  }
}
