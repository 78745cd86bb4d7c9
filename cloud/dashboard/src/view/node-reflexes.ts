import type { NodeMonitorItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { parseInstant, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { element, setText } from "./element";
import { lampSymbol } from "./symbol";

const REFRESH_MS = 5_000;
/** How soon it is asked again when something has changed, and how often at most. */
const SOON_MS = 200;
const LEAST_MS = 1_000;
const DAY = 86_400_000_000_000n;

/** What is said of a monitor's latest verdict: since when it holds, or when it was stated of what may have changed. */
export function verdictText({ latest }: NodeMonitorItem, now: bigint): string {
  if (latest === null) return "no verdict yet";
  const instant = parseInstant(latest.time.lo);
  const day = now - instant > DAY / 2n ? `${printDay(instant)} ` : "";
  const because = latest.because.length === 0 ? "" : ` by ${latest.because.join(", ")}`;
  const when = `${day}${printClock(instant, 2)}`;
  return latest.current ? `${latest.verdict}${because} since ${when}` : `unknown now; ${latest.verdict}${because} at ${when}`;
}

/** What is said of a monitor's output. */
export function outputText({ output, level }: NodeMonitorItem): string {
  return output === "none" ? "no output" : `${output} ${level ?? "unknown"}`;
}

/** Whether a monitor runs as it is desired to; one of the node's own file is. */
export function isSettled({ desired, reported }: NodeMonitorItem): boolean {
  if (desired === null) return true;
  return reported !== null && Object.entries(desired).every(([name, value]) => reported[name] === value);
}

/** The monitors that run on a node, each with its latest verdict and a lamp for its output; hidden where there are none. */
export class NodeReflexes {
  readonly root: HTMLElement;
  private readonly list = element("ul", { class: "reflex-list", "data-testid": "reflexes" });
  private readonly note = element("span", { class: "settings-note", role: "status" });
  private readonly loading = new AbortController();
  private dueAt = 0;
  private leastAt = 0;
  private busy = false;
  private shown = "";

  constructor(
    private readonly context: Context,
    private readonly node: string,
  ) {
    const head = element("h3", { class: "reflex-head" }, "Reflexes", this.note);
    this.root = element("section", { class: "node-reflexes", "aria-label": `reflexes of ${node}`, hidden: true }, head, this.list);
  }

  /** A verdict was stated, or a command answered: what is shown is out of date. */
  refresh(): void {
    this.dueAt = Math.min(this.dueAt, Math.max(performance.now() + SOON_MS, this.leastAt));
  }

  frame(at: number): void {
    if (this.busy || at < this.dueAt || document.hidden) return;
    this.dueAt = at + REFRESH_MS;
    this.leastAt = at + LEAST_MS;
    void this.load();
  }

  destroy(): void {
    this.loading.abort();
  }

  private async load(): Promise<void> {
    this.busy = true;
    try {
      this.show(await this.context.client.nodeMonitors(this.node, this.loading.signal));
      setText(this.note, "");
    } catch (error) {
      if (!isAbort(error)) setText(this.note, `They could not be loaded: ${messageOf(error)}`);
    } finally {
      this.busy = false;
    }
  }

  private show(monitors: readonly NodeMonitorItem[]): void {
    const state = JSON.stringify(monitors);
    if (state === this.shown) return;
    this.shown = state;
    this.root.hidden = monitors.length === 0;
    const now = BigInt(Date.now()) * 1_000_000n;
    this.list.replaceChildren(...monitors.map((monitor) => reflexRow(monitor, now)));
  }
}

function reflexRow(monitor: NodeMonitorItem, now: bigint): HTMLElement {
  const { name, formula, on, latest, level, output } = monitor;
  const verdict = latest?.current ? latest.verdict : "unknown";
  const look = verdict === "unknown" ? "missing" : `strip-${verdict}`;
  return element(
    "li",
    { "data-testid": "reflex", "data-monitor": name, "data-verdict": verdict, "data-level": level ?? "unknown" },
    element("span", { class: "reflex-lamp" }, output === "none" ? null : lampSymbol(level ?? "unknown"), outputText(monitor)),
    element("strong", {}, name),
    element("code", {}, formula),
    output === "none" ? null : element("span", { class: "reflex-rule" }, `on when ${on}`),
    element("span", { class: "reflex-verdict" }, element("i", { class: `swatch ${look}` }), verdictText(monitor, now)),
    isSettled(monitor) ? null : element("span", { class: "mark-waits" }, "not as desired yet"),
  );
}
