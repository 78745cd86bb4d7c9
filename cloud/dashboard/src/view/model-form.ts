import type { PredictionQuery } from "../api/client";
import type { ModelItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { readPrediction } from "../chart/predicted";
import { readSegment, type Segment } from "../chart/segments";
import { type Interval, readInterval } from "../interval/interval";
import { type Given, type ModelQuestion, printGiven } from "../state/route";
import type { Range } from "../state/window";
import { type Instant, NS_PER_SECOND, parseInstant, printInstant } from "../time/instant";
import { type Entries, NOTHING } from "../tube/entries";
import type { Context } from "./context";
import { button, element } from "./element";
import { IntervalField } from "./interval-field";
import { RequestTimer, totalsAnswer, type Wording } from "./question-parts";

export interface ModelFormOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: string;
  readonly unit: string;
  /** The channel's own bounds, to begin with where a model has no usual ones. */
  readonly bounds: Interval | null;
  readonly range: () => Range | null;
  /** How many buckets the tube is drawn with. */
  readonly points: () => number;
  readonly onAnswer: (predicted: Entries, anomalies: readonly Segment[]) => void;
}

/** A live window moves on while an answer is shown; what is predicted is known ahead. */
const AHEAD = 5n * NS_PER_SECOND;
const WORDING: Wording = {
  state: "Not as predicted",
  never: "No anomaly",
  because: (window) => `all that is known in this window of ${window} is as predicted`,
  name: "anomalous",
};
const LOADING = "Loading models…";
const INTRODUCTION = "Certain: no value of the interval is predicted. Possible: some value is not.";

function keyOf(question: ModelQuestion | null): string {
  return question === null ? "" : [question.model, question.origin, ...question.parameters.map(printGiven)].join(" ");
}

/** Compares a channel with a model: paints the predicted tube, and shows for how long the channel left it. */
export class ModelForm {
  readonly root: HTMLDetailsElement;
  private readonly form = element("form", { class: "model-form", "aria-label": "comparison with a model", "data-testid": "model-form" });
  private readonly model = element("select", { name: "model", "aria-label": "model", "data-testid": "model" });
  private readonly about = element("p", { class: "about" });
  private readonly parameters = element("div", { class: "parameters" });
  private readonly origin = element("input", { type: "text", class: "origin", autocomplete: "off", spellcheck: "false", "aria-label": "time 0 of the model, RFC 3339", placeholder: "start of the window", "data-testid": "model-origin" });
  private readonly answer = element("p", { class: "answer", role: "status", "data-testid": "model-answer" });
  private readonly clock = new RequestTimer();
  private readonly loading = new AbortController();
  private models: readonly ModelItem[] | null = null;
  private fields: readonly IntervalField[] = [];
  private asking: AbortController | null = null;
  private applied: ModelQuestion | null = null;
  private anomalies: readonly Segment[] = [];
  private complaining = false;

  constructor(private readonly options: ModelFormOptions) {
    const compare = element("button", { type: "submit", class: "plain", "data-testid": "model-ask" }, "Compare");
    const clear = button("Clear", { class: "plain quiet" }, () => this.clear());
    const origin = element("label", { class: "interval-field" }, element("span", { class: "name" }, "time 0"), this.origin);
    const key = element("span", { class: "key" }, element("i", { class: "swatch predicted" }), "predicted");
    this.form.append(element("div", { class: "fields" }, this.model, key), this.about, this.parameters, element("div", { class: "fields" }, origin, compare, clear));
    this.root = element("details", { class: "compare", "data-testid": "compare", "aria-label": "models" }, element("summary", {}, "Compare with a model"), this.form, this.answer);
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
    this.model.addEventListener("change", () => this.showModel(null));
    this.root.addEventListener("toggle", () => {
      if (this.root.open) void this.load();
    });
    this.form.hidden = true;
  }

  /** Takes over a question from the address, or the change of the window. */
  apply(question: ModelQuestion | null): void {
    const same = keyOf(this.applied) === keyOf(question);
    this.applied = question;
    if (same && this.complaining) return;
    if (!same) this.fill();
    if (question !== null) {
      this.root.open = true;
      this.clock.settle();
      return;
    }
    this.asking?.abort();
    this.clock.stop();
    if (same) return;
    this.mark(NOTHING, []);
    if (this.models !== null) this.answer.textContent = INTRODUCTION;
  }

  frame(at: number): void {
    if (this.applied === null || this.complaining) return;
    if (!this.clock.isDue(at, this.options.context.route().view)) return;
    const range = this.options.range();
    if (range === null) return;
    this.clock.ask(at);
    void this.ask(this.applied, range);
  }

  destroy(): void {
    this.loading.abort();
    this.asking?.abort();
  }

  private async load(): Promise<void> {
    if (this.models !== null) return;
    this.answer.textContent = LOADING;
    try {
      const all = await this.options.context.client.models(this.loading.signal);
      if (this.models !== null) return;
      this.models = all.filter(({ unit }) => unit === null || unit === this.options.unit);
    } catch (error) {
      if (isAbort(error)) return;
      const again = button("Try again", { class: "plain" }, () => void this.load());
      this.answer.replaceChildren(`The models could not be loaded: ${messageOf(error)} `, again);
      return;
    }
    if (this.models.length === 0) {
      this.answer.textContent = `No model predicts a quantity in ${this.options.unit}.`;
      return;
    }
    this.model.replaceChildren(...this.models.map(({ id }) => element("option", { value: id }, id.replace(".", ": ").replaceAll("_", " "))));
    this.form.hidden = false;
    // A question of the address may have its answer by now.
    if (this.answer.textContent === LOADING) this.answer.textContent = this.applied === null ? INTRODUCTION : "Asking…";
    this.fill();
  }

  /** Shows the question in the fields, or the first model as it usually is. */
  private fill(): void {
    this.complaining = false;
    if (this.models === null || this.models.length === 0) return;
    const question = this.applied;
    if (question !== null) this.model.value = question.model;
    if (question === null) return this.fields.length === 0 ? this.showModel(null) : undefined;
    this.origin.value = printInstant(question.origin).replace(/\.?0+Z$/, "Z");
    this.origin.removeAttribute("aria-invalid");
    this.showModel(question.parameters);
  }

  /** Makes the fields of the chosen model, with what is given or usual. */
  private showModel(given: readonly Given[] | null): void {
    const model = this.models?.find(({ id }) => id === this.model.value);
    this.about.textContent = model?.description ?? "";
    this.fields = (model?.parameters ?? []).map((parameter) => {
      const field = new IntervalField(parameter, parameter.unit ?? this.options.unit);
      const usual = parameter.usual === null ? this.options.bounds : readInterval(parameter.usual);
      field.set(given?.find(({ name }) => name === parameter.name) ?? usual);
      return field;
    });
    this.parameters.replaceChildren(...this.fields.map(({ root }) => root));
  }

  private submit(): void {
    this.complaining = false;
    const bad: string[] = [];
    const parameters: Given[] = [];
    for (const field of this.fields) {
      if (field.empty && !field.parameter.required) continue;
      const bounds = field.read();
      if (bounds === null) bad.push(field.name);
      else parameters.push({ name: field.parameter.name, ...bounds });
    }
    const origin = this.readOrigin();
    if (bad.length > 0) this.complain(`Give ${bad.join(", ")} as a lower and an upper bound, such as 9 and 11.`);
    else if (origin === null) this.complain("Give time 0 as RFC 3339, such as 2026-01-31T12:00:00Z, or leave it empty.");
    else this.go({ kind: "model", model: this.model.value, origin, parameters });
  }

  /** What was typed; where nothing was, the whole second in which the window begins. */
  private readOrigin(): Instant | null {
    const text = this.origin.value.trim();
    const range = this.options.range();
    this.origin.removeAttribute("aria-invalid");
    if (text === "" && range !== null) {
      const start = this.options.context.timeline.toInstant(range.x0);
      return (start / NS_PER_SECOND) * NS_PER_SECOND;
    }
    try {
      return parseInstant(text);
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
      this.origin.setAttribute("aria-invalid", "true");
      return null;
    }
  }

  /** Says what cannot be asked; it stays until the question changes. */
  private complain(text: string): void {
    this.complaining = true;
    this.asking?.abort();
    this.mark(NOTHING, []);
    this.answer.textContent = text;
    this.form.querySelector<HTMLElement>("[aria-invalid=true]")?.focus();
  }

  private clear(): void {
    this.complaining = false;
    this.origin.value = "";
    this.showModel(null);
    this.answer.textContent = INTRODUCTION;
    if (this.applied !== null) this.go(null);
  }

  private go(question: ModelQuestion | null): void {
    const { context } = this.options;
    if (question !== null) this.answer.textContent = "Asking…";
    context.go({ ...context.route(), question }, "replace");
  }

  private async ask(question: ModelQuestion, range: Range): Promise<void> {
    const { context, node, channel, points } = this.options;
    const { client, timeline } = context;
    this.asking?.abort();
    const asking = new AbortController();
    this.asking = asking;
    const { signal } = asking;
    const target = { node, channel };
    const query: PredictionQuery = {
      model: question.model,
      origin: question.origin,
      parameter: question.parameters.map(printGiven),
      start: timeline.toInstant(range.x0),
      end: timeline.toInstant(Math.ceil(range.x1)),
    };
    const ahead = context.route().view.kind === "live" ? AHEAD : 0n;
    let predicted = NOTHING;
    try {
      const tube = await client.prediction(target, { ...query, end: query.end + ahead, points: points() }, signal);
      predicted = readPrediction(tube, timeline);
      this.mark(predicted, this.anomalies);
      const [segments, time] = await Promise.all([client.anomalies(target, query, signal), client.anomaliesTime(target, query, signal)]);
      this.mark(predicted, segments.items.map((item) => readSegment(item, timeline)));
      this.answer.replaceChildren(...totalsAnswer(time, range, { wording: WORDING, complete: segments.complete }));
    } catch (error) {
      if (isAbort(error)) return;
      // What is predicted may be known though there is too much to be compared with it.
      this.mark(predicted, []);
      this.answer.replaceChildren(element("strong", { class: "bad" }, "No answer"), `: ${messageOf(error)}`);
    } finally {
      if (this.asking === asking) this.clock.answered();
    }
  }

  private mark(predicted: Entries, anomalies: readonly Segment[]): void {
    this.anomalies = anomalies;
    this.options.onAnswer(predicted, anomalies);
  }
}
