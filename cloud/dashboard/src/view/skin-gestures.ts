import { ApiError, isAbort } from "../api/error";
import { askedLive, GestureLog, type GestureMark, kindText, marksOf } from "../skin/gestures";
import type { Range } from "../state/window";
import { printClock } from "../time/instant";
import type { Context } from "./context";
import { element, setText } from "./element";
import { verdictSymbol } from "./symbol";

/** Gestures that are kept. */
const MOST = 200;
const LISTED = 5;
/** The cloud is asked once in so long (ms), and is given twice as long to rest as it took to answer. */
const PERIOD_MS = 1_000;
const REST = 2;
const RETRY_MS = 5_000;
/** Windows of the past that are not asked for again. */
const MOST_ASKED = 500;
/** Gestures are shown for so long (ns) after their ends; live, after they are known. */
const LINGER = 0.6e9;
const LIVE_LINGER = 1.5e9;
/** Then no gestures are to be had of this skin. */
const REFUSALS: ReadonlySet<number | null> = new Set([404, 422]);

/** The gestures on a skin: asked of the cloud in short windows, and listed. */
export class SkinGestures {
  readonly root: HTMLElement;
  private readonly list = element("ol", { class: "gesture-list", "data-testid": "gestures" });
  private readonly note = element("span", { class: "settings-note" });
  private readonly log = new GestureLog(MOST);
  /** The windows of the past that were asked for. */
  private readonly asked = new Set<string>();
  /** Where the latest live window ended, and whether the one before had ended before it began. */
  private askedTo: number | null = null;
  private hasGaps = false;
  /** How long after its end a gesture is known, at most, in ns: from answer to answer. */
  private delay = PERIOD_MS * 1e6;
  /** When the touch began that went on at the end of the latest window; null: none did. */
  private since: number | null = null;
  private loading = new AbortController();
  private busy = false;
  private refused = false;
  private dueAt = 0;
  private listed = "";

  constructor(
    private readonly context: Context,
    private readonly node: string,
    private readonly onChange: () => void,
  ) {
    const head = element("h3", { class: "gesture-head" }, "Gestures", this.note);
    this.root = element("section", { class: "skin-gestures", "aria-label": "gestures", hidden: true }, head, this.list);
  }

  /** Another skin is shown, or another quantity. */
  reset(): void {
    this.loading.abort();
    this.loading = new AbortController();
    this.log.clear();
    this.asked.clear();
    this.since = null;
    this.askedTo = null;
    this.hasGaps = false;
    this.refused = false;
    this.dueAt = 0;
    this.root.hidden = true;
  }

  /** Asks for the newest gestures, if it is time to. */
  wantLive(end: number, at: number): void {
    if (!this.isDue(at)) return;
    const window = askedLive(end, this.since);
    this.hasGaps = this.askedTo !== null && window.x0 > this.askedTo;
    this.askedTo = end;
    void this.ask(window, true);
  }

  /** Asks for a window of the past, once, if it is time to. */
  wantPast(window: Range, at: number): void {
    if (this.isDue(at) && !this.asked.has(`${window.x0} ${window.x1}`)) void this.ask(window, false);
  }

  /** What is shown at a position. */
  at(position: number, live: boolean): GestureMark[] {
    return this.log.at(position, live ? LIVE_LINGER + this.delay : LINGER);
  }

  /** Lists the latest gestures up to a position. */
  write(position: number | null): void {
    const marks = position === null ? [] : this.log.latest(position, LISTED);
    const note = this.hasGaps ? "some are left out: the cloud takes too long to find all" : marks.length === 0 ? "none yet" : "";
    setText(this.note, note);
    const state = JSON.stringify(marks);
    if (state === this.listed) return;
    this.listed = state;
    this.list.replaceChildren(...marks.map((mark) => this.row(mark)));
  }

  destroy(): void {
    this.loading.abort();
  }

  private isDue(at: number): boolean {
    return !this.busy && !this.refused && at >= this.dueAt && !document.hidden;
  }

  private async ask(window: Range, live: boolean): Promise<void> {
    const { client, timeline } = this.context;
    const { signal } = this.loading;
    const begun = performance.now();
    this.busy = true;
    try {
      const asked = { start: timeline.toInstant(window.x0), end: timeline.toInstant(window.x1) };
      const items = await client.gestures(this.node, asked, signal);
      const marks = marksOf(items, window, timeline);
      // One that began before a long window is not waited for: its gestures are possible at most.
      const going = marks.filter(({ touched, cutsBegin, cutsEnd }) => touched && cutsEnd && !cutsBegin);
      this.since = going.length === 0 ? null : Math.min(...going.map(({ begin }) => begin));
      // A touch that goes on is no gesture yet.
      this.log.put(window, live ? marks.filter(({ cutsEnd }) => !cutsEnd) : marks);
      if (!live) this.asked.add(`${window.x0} ${window.x1}`);
      if (this.asked.size > MOST_ASKED) this.asked.clear();
      const took = performance.now() - begun;
      const rest = Math.max(PERIOD_MS - took, REST * took);
      this.dueAt = performance.now() + rest;
      this.delay = (2 * took + rest) * 1e6;
      this.root.hidden = false;
      this.onChange();
    } catch (error) {
      if (isAbort(error)) return;
      this.refused = error instanceof ApiError && REFUSALS.has(error.status);
      this.root.hidden = this.refused;
      this.dueAt = performance.now() + RETRY_MS;
    } finally {
      this.busy = false;
    }
  }

  private row(mark: GestureMark): HTMLElement {
    const { timeline } = this.context;
    const [begin, end] = [timeline.toInstant(mark.begin), timeline.toInstant(mark.end)];
    const from = mark.cutsBegin ? "before " : "";
    const to = mark.cutsEnd ? "still going on" : `to ${printClock(end, 2)}`;
    return element(
      "li",
      { "data-testid": "gesture", "data-verdict": mark.verdict },
      verdictSymbol(mark.verdict),
      element("b", {}, kindText(mark)),
      element("span", {}, mark.verdict),
      element("time", {}, `${from}${printClock(begin, 2)} ${to}`),
    );
  }
}
