import type { WindowedFormula } from "../api/client";
import type { ChannelItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { readStretches, type VerdictStretch } from "../chart/verdict-stretches";
import type { FormulaQuestion } from "../state/route";
import type { Range } from "../state/window";
import type { Instant } from "../time/instant";
import { WatchForm } from "./alarm-board";
import { CompletionList } from "./completion-list";
import type { Context } from "./context";
import { button, element } from "./element";
import { offerAt } from "./formula-completion";
import { falseVerdicts, RequestTimer, totalsAnswer, type Wording } from "./question-parts";

export interface FormulaFormOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: string;
  readonly range: () => Range | null;
  /** Where what is stored of the channel ends; null before there is any. */
  readonly latest: () => Instant | null;
  /** Takes the verdicts of the window, in order of time; none where there is no answer. */
  readonly onStretches: (stretches: readonly VerdictStretch[]) => void;
}

const INTRODUCTION = "Certain: it holds for all values and instants that the samples leave open. Possible: for some.";
const WORDING: Wording = {
  state: "The formula holds",
  never: "Impossible",
  because: (window) => `the formula holds nowhere in this window of ${window}`,
  name: "formula",
};

/** Asks when a formula over the node's channels holds, and shows for how long it certainly and possibly did. */
export class FormulaForm {
  readonly root: HTMLDetailsElement;
  private readonly text = element("input", { type: "text", class: "formula", autocomplete: "off", spellcheck: "false", "aria-label": "formula", "data-testid": "formula" });
  private readonly answer = element("p", { class: "answer", role: "status", "data-testid": "formula-answer" }, INTRODUCTION);
  private readonly clock = new RequestTimer();
  private asking: AbortController | null = null;
  private applied: FormulaQuestion | null = null;
  private readonly loading = new AbortController();
  /** Of the node, for completions; as long as they are not there, only operators are offered. */
  private channels: readonly ChannelItem[] | null = null;

  constructor(private readonly options: FormulaFormOptions) {
    this.text.placeholder = `once[0,200ms] ${options.channel} > 1`;
    const completions = new CompletionList(this.text, (text, caret) => offerAt(text, caret, this.channels ?? []));
    this.text.addEventListener("focus", () => void this.load());
    const ask = element("button", { type: "submit", class: "plain", "data-testid": "formula-ask" }, "Ask");
    const clear = button("Clear", { class: "plain quiet" }, () => this.go(null));
    const form = element("form", { class: "formula-form", "aria-label": "formula over channels" }, element("div", { class: "fields" }, completions.root, ask, clear));
    const watch = new WatchForm({ client: options.context.client, node: options.node, formula: () => this.text.value.trim(), latest: options.latest });
    this.text.addEventListener("input", () => watch.reset());
    this.root = element("details", { class: "compare", "data-testid": "formulas", "aria-label": "formulas" }, element("summary", {}, "Ask with a formula"), form, this.answer, watch.root);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const formula = this.text.value.trim();
      this.go(formula === "" ? null : { kind: "formula", formula });
    });
  }

  /** Takes over a question from the address, or the change of the window. */
  apply(question: FormulaQuestion | null): void {
    const same = this.applied?.formula === question?.formula;
    this.applied = question;
    if (question !== null) {
      this.root.open = true;
      if (document.activeElement !== this.text) this.text.value = question.formula;
      this.clock.settle();
      if (!same) this.answer.textContent = "Asking…";
    } else this.clock.stop();
    if (same) return;
    this.asking?.abort();
    this.options.onStretches([]);
    if (question === null) this.answer.textContent = INTRODUCTION;
  }

  frame(at: number): void {
    if (this.applied === null) return;
    if (!this.clock.isDue(at, this.options.context.route().view)) return;
    const range = this.options.range();
    if (range === null) return;
    this.clock.ask(at);
    void this.ask(this.applied, range);
  }

  destroy(): void {
    this.asking?.abort();
    this.loading.abort();
  }

  /** Loads the node's channels once. */
  private async load(): Promise<void> {
    if (this.channels !== null) return;
    this.channels = [];
    try {
      this.channels = await this.options.context.client.channels(this.options.node, this.loading.signal);
    } catch {
      // The next focus tries again; the field works without.
      this.channels = null;
    }
  }

  private go(question: FormulaQuestion | null): void {
    const { context } = this.options;
    if (question === null) this.text.value = "";
    if (question === null && this.applied === null) return;
    context.go({ ...context.route(), question }, "replace");
  }

  private async ask(question: FormulaQuestion, range: Range): Promise<void> {
    const { context, node, onStretches } = this.options;
    const { client, timeline } = context;
    this.asking?.abort();
    const asking = new AbortController();
    this.asking = asking;
    const { signal } = asking;
    const query: WindowedFormula = { formula: question.formula, node, start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)) };
    try {
      const [stretches, time] = await Promise.all([client.verdicts(query, signal), client.verdictTime(query, signal)]);
      onStretches(readStretches(stretches.items, timeline));
      this.answer.replaceChildren(...totalsAnswer(time, range, { wording: WORDING, complete: stretches.complete }), " ", element("span", { "data-testid": "formula-false" }, falseVerdicts(time.false_a_year)));
    } catch (error) {
      if (isAbort(error)) return;
      // Marks of another window or formula are no answer to this question.
      onStretches([]);
      this.answer.replaceChildren(element("strong", { class: "bad" }, "No answer"), `: ${messageOf(error)}`);
    } finally {
      if (this.asking === asking) this.clock.answered();
    }
  }
}
