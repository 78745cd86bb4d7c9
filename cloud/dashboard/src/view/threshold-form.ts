import type { SegmentItem } from "../api/contract";
import { isAbort, messageOf } from "../api/failure";
import type { Segment } from "../chart/segments";
import { decimalExponent } from "../interval/decimal";
import { parseTyped, printTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import type { ThresholdQuestion } from "../state/place";
import type { Range } from "../state/window";
import { formatDuration } from "../time/duration";
import { parseInstant } from "../time/instant";
import { AskClock } from "./ask-clock";
import type { Context } from "./context";
import { button, element } from "./element";

export interface ThresholdOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: string;
  readonly unit: string;
  /** The typical magnitude of the channel, which chooses the prefix that people type in. */
  readonly magnitude: number;
  readonly range: () => Range | null;
  /** Whether anything is known in a window: where nothing is, nothing is impossible either. */
  readonly known: (range: Range) => boolean;
  readonly onSegments: (segments: readonly Segment[]) => void;
}

const INTRODUCTION = "Certain: the whole interval passes. Possible: a part of it does.";

/** The sums of the answers: certain time is a lower bound, certain and possible together an upper one. */
export function sumSegments(segments: readonly Segment[], within: Range): { certain: number; atMost: number } {
  let certain = 0;
  let possible = 0;
  for (const { x0, x1, verdict } of segments) {
    const length = Math.max(0, Math.min(x1, within.x1) - Math.max(x0, within.x0));
    if (verdict === "certain") certain += length;
    else possible += length;
  }
  return { certain, atMost: certain + possible };
}

/** Says in how many segments, and nothing where there is none. */
export function inSegments(count: number, more: boolean): string {
  if (count === 0) return "";
  return ` in ${count} ${more ? "more " : ""}${count === 1 ? "segment" : "segments"}`;
}

function sameQuestion(one: ThresholdQuestion | null, other: ThresholdQuestion | null): boolean {
  return one?.side === other?.side && one?.level === other?.level;
}

/** Asks when a channel passes a threshold, and says how long it certainly and possibly did. */
export class ThresholdForm {
  readonly root: HTMLFormElement;
  private readonly side = element("select", { name: "side", "aria-label": "side" });
  private readonly level = element("input", { name: "level", type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": "threshold", placeholder: "level", "data-testid": "threshold-level" });
  private readonly answer = element("p", { class: "answer", role: "status", "data-testid": "threshold-answer" });
  private readonly prefix: number;
  private asking: AbortController | null = null;
  private applied: ThresholdQuestion | null = null;
  private readonly clock = new AskClock();

  constructor(private readonly options: ThresholdOptions) {
    const unit = findUnit(options.unit);
    const prefix = choosePrefix(unit, options.magnitude > 0 ? decimalExponent(options.magnitude) : 0);
    this.prefix = prefix.exponent;
    for (const side of ["above", "below"]) this.side.append(element("option", { value: side }, side));
    this.side.dataset["testid"] = "threshold-side";
    const label = element("span", { class: "unit" }, `${prefix.symbol}${unit.symbol}`);
    const ask = element("button", { type: "submit", class: "plain", "data-testid": "threshold-ask" }, "Ask");
    const clear = button("Clear", { class: "plain quiet" }, () => this.go(null));
    const fields = element("div", { class: "fields" }, element("span", {}, "When is it"), this.side, element("span", { class: "with-unit" }, this.level, label), ask, clear);
    this.root = element("form", { class: "threshold", "aria-label": "threshold question", "data-testid": "threshold" }, fields, this.answer);
    this.root.addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
    this.answer.textContent = INTRODUCTION;
    this.side.addEventListener("change", () => {
      if (this.level.value.trim() !== "") this.submit();
    });
  }

  /** Takes over a question from the address, or the change of the window. */
  apply(question: ThresholdQuestion | null): void {
    const same = sameQuestion(this.applied, question);
    this.applied = question;
    // What was typed in vain stays with its complaint, wherever the window goes.
    if (same && this.invalid) return;
    if (document.activeElement !== this.level) {
      this.level.value = question ? printTyped(question.level, this.prefix) : "";
      this.level.removeAttribute("aria-invalid");
    }
    if (question) {
      this.side.value = question.side;
      this.clock.settle();
    } else {
      this.asking?.abort();
      this.clock.stop();
      this.answer.textContent = INTRODUCTION;
      if (!same) this.options.onSegments([]);
    }
  }

  frame(at: number): void {
    if (this.applied === null || this.invalid) return;
    if (!this.clock.isDue(at, this.options.context.place().view)) return;
    const range = this.options.range();
    if (range === null) return;
    this.clock.ask(at);
    void this.ask(this.applied, range);
  }

  /** While what was typed cannot be asked, the complaint stays, and no answer overwrites it. */
  private get invalid(): boolean {
    return this.level.getAttribute("aria-invalid") === "true";
  }

  destroy(): void {
    this.asking?.abort();
  }

  private submit(): void {
    const level = parseTyped(this.level.value, this.prefix);
    this.level.setAttribute("aria-invalid", String(level === null));
    if (level !== null) this.go({ kind: "threshold", side: this.side.value === "below" ? "below" : "above", level });
    else {
      this.asking?.abort();
      this.answer.textContent = `"${this.level.value}" is not a number. Type a level such as 12.5.`;
    }
  }

  private go(question: ThresholdQuestion | null): void {
    const { context } = this.options;
    if (question === null) {
      this.level.value = "";
      this.level.removeAttribute("aria-invalid");
      this.answer.textContent = INTRODUCTION;
      if (this.applied === null) return;
    }
    context.go({ ...context.place(), question }, "replace");
  }

  private async ask(question: ThresholdQuestion, range: Range): Promise<void> {
    const { context, node, channel } = this.options;
    this.asking?.abort();
    this.asking = new AbortController();
    const window = { start: context.timeline.toInstant(range.x0), end: context.timeline.toInstant(Math.ceil(range.x1)) };
    const side = question.side === "above" ? { above: question.level } : { below: question.level };
    try {
      const found = await context.client.threshold({ node, channel }, { ...side, ...window }, this.asking.signal);
      const segments = found.items.map((item) => this.read(item));
      this.options.onSegments(segments);
      this.tell(question, segments, range, found.complete);
    } catch (error) {
      if (!isAbort(error)) this.answer.textContent = `No answer: ${messageOf(error)}`;
    }
  }

  private read(item: SegmentItem): Segment {
    const { timeline } = this.options.context;
    const x0 = timeline.toX(parseInstant(item.start));
    return { x0, x1: timeline.toX(parseInstant(item.end)), verdict: item.verdict };
  }

  private tell(question: ThresholdQuestion, segments: readonly Segment[], range: Range, complete: boolean): void {
    const certain = segments.filter((segment) => segment.verdict === "certain").length;
    const more = segments.length - certain;
    const sums = sumSegments(segments, range);
    const unit = this.root.querySelector(".unit")?.textContent ?? "";
    const level = `${question.side} ${printTyped(question.level, this.prefix)} ${unit}`.trim();
    const window = formatDuration(range.x1 - range.x0);
    const parts = [
      element("strong", { "data-testid": "total-certain", "data-ns": sums.certain }, `certainly ${formatDuration(sums.certain, "down")}`),
      element("span", {}, `${inSegments(certain, false)}, `),
      element("strong", { "data-testid": "total-possible", "data-ns": sums.atMost }, `possibly up to ${formatDuration(sums.atMost, "up")}`),
      element("span", {}, `${inSegments(more, certain > 0)}, of ${window}.`),
      complete ? "" : element("span", { class: "warn" }, " Too many segments to show all: zoom in."),
    ];
    if (segments.length === 0 && !this.options.known(range)) {
      this.answer.textContent = "Nothing is known in this window, so there is no answer.";
    } else if (segments.length === 0) {
      this.answer.replaceChildren(element("strong", {}, "Impossible"), `: no sample in this window of ${window} is ${level}.`);
    } else this.answer.replaceChildren(`${level}: `, ...parts);
  }
}
