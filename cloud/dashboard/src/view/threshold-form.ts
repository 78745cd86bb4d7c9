import type { ThresholdQuery } from "../api/client";
import { isAbort, messageOf } from "../api/error";
import { readSegment, type Segment } from "../chart/segments";
import { decimalExponent } from "../interval/decimal";
import { parseTyped, printTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import type { ThresholdQuestion } from "../state/route";
import type { Range } from "../state/window";
import type { Context } from "./context";
import { button, element } from "./element";
import { RequestTimer, totalsAnswer, type Wording } from "./question-parts";

export interface ThresholdOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: string;
  readonly unit: string;
  /** The typical magnitude of the channel, which chooses the prefix of the input. */
  readonly magnitude: number;
  readonly range: () => Range | null;
  readonly onSegments: (segments: readonly Segment[]) => void;
}

const INTRODUCTION = "Certain: the whole interval passes. Possible: a part of it does.";

function sameQuestion(one: ThresholdQuestion | null, other: ThresholdQuestion | null): boolean {
  return one?.side === other?.side && one?.level === other?.level;
}

/** Asks when a channel passes a threshold, and shows for how long it certainly and possibly did. */
export class ThresholdForm {
  readonly root: HTMLFormElement;
  private readonly side = element("select", { name: "side", "aria-label": "side" });
  private readonly level = element("input", { name: "level", type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": "threshold", placeholder: "level", "data-testid": "threshold-level" });
  private readonly answer = element("p", { class: "answer", role: "status", "data-testid": "threshold-answer" });
  private readonly prefix: number;
  private asking: AbortController | null = null;
  private applied: ThresholdQuestion | null = null;
  private readonly clock = new RequestTimer();

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
    // Invalid input stays with its message, whatever the window.
    if (same && this.invalid) return;
    if (document.activeElement !== this.level) {
      this.level.value = question ? printTyped(question.level, this.prefix) : "";
      this.level.removeAttribute("aria-invalid");
    }
    if (question) {
      this.side.value = question.side;
      this.clock.settle();
      if (!same && !this.invalid) {
        this.asking?.abort();
        this.options.onSegments([]);
        this.answer.textContent = "Asking…";
      }
    } else {
      this.asking?.abort();
      this.clock.stop();
      this.answer.textContent = INTRODUCTION;
      if (!same) this.options.onSegments([]);
    }
  }

  frame(at: number): void {
    if (this.applied === null || this.invalid) return;
    if (!this.clock.isDue(at, this.options.context.route().view)) return;
    const range = this.options.range();
    if (range === null) return;
    this.clock.ask(at);
    void this.ask(this.applied, range);
  }

  /** While what was typed cannot be asked, the error stays, and no answer overwrites it. */
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
    context.go({ ...context.route(), question }, "replace");
  }

  private async ask(question: ThresholdQuestion, range: Range): Promise<void> {
    const { context, node, channel } = this.options;
    this.asking?.abort();
    const asking = new AbortController();
    this.asking = asking;
    const { signal } = asking;
    const target = { node, channel };
    const side = question.side === "above" ? { above: question.level } : { below: question.level };
    const query: ThresholdQuery = { ...side, start: context.timeline.toInstant(range.x0), end: context.timeline.toInstant(Math.ceil(range.x1)) };
    try {
      const [segments, time] = await Promise.all([context.client.threshold(target, query, signal), context.client.thresholdTime(target, query, signal)]);
      this.options.onSegments(segments.items.map((item) => readSegment(item, context.timeline)));
      this.answer.replaceChildren(...totalsAnswer(time, range, { wording: this.wording(question), complete: segments.complete }));
    } catch (error) {
      if (isAbort(error)) return;
      // Marks of another window or level are no answer to this question.
      this.options.onSegments([]);
      this.answer.replaceChildren(element("strong", { class: "bad" }, "No answer"), `: ${messageOf(error)}`);
    } finally {
      if (this.asking === asking) this.clock.answered();
    }
  }

  private wording(question: ThresholdQuestion): Wording {
    const unit = this.root.querySelector(".unit")?.textContent ?? "";
    const state = `${question.side} ${printTyped(question.level, this.prefix)} ${unit}`.trim();
    return { state, never: "Impossible", because: (window) => `no sample in this window of ${window} is ${state}`, name: "total" };
  }
}
