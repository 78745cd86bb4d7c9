import type { View } from "../state/route";
import type { Range } from "../state/window";
import { NS_PER_SECOND } from "../time/instant";
import { nameZone, printTypedInstant, type RefusedRange, readTypedRange, type TypedRange } from "../time/typed-time";
import type { Context } from "./context";
import { button, element } from "./element";

export interface TimeFormOptions {
  readonly context: Context;
  /** The window shown now. */
  readonly range: () => Range | null;
  /** From the first to the last sample of what is shown. */
  readonly extent: () => Range | null;
}

const HOUR = 3_600n * NS_PER_SECOND;
const QUICK: readonly { readonly name: string; readonly label: string; readonly ns: bigint }[] = [
  { name: "1h", label: "1 h", ns: HOUR },
  { name: "24h", label: "24 h", ns: 24n * HOUR },
  { name: "7d", label: "7 d", ns: 7n * 24n * HOUR },
  { name: "30d", label: "30 d", ns: 30n * 24n * HOUR },
];
const SECOND = 1e9;

function timeField(name: "from" | "to"): HTMLInputElement {
  return element("input", { type: "text", name, autocomplete: "off", spellcheck: "false", "aria-describedby": "time-zone time-error", "data-testid": `time-${name}` });
}

/** Goes to a stretch of time that is typed, or to the last hour, day, week or month of the data. */
export class TimeForm {
  /** Opens and closes the form. */
  readonly toggle = button("Times", { "aria-expanded": "false", "aria-controls": "time-form", title: "Choose from when to when", "data-testid": "times" }, () => this.open(this.root.hidden !== false));
  readonly root = element("form", { id: "time-form", class: "times", "aria-label": "time range", hidden: true, "data-testid": "time-form" });
  private readonly fields = { from: timeField("from"), to: timeField("to") };
  private readonly zone = element("p", { id: "time-zone", "data-testid": "time-zone" });
  private readonly error = element("p", { id: "time-error", class: "range-error", role: "alert", "data-testid": "time-error" });
  /** Whether the fields hold input that was not submitted. */
  private edited = false;

  constructor(private readonly options: TimeFormOptions) {
    const quick = QUICK.map(({ name, label, ns }) => button(label, { "aria-label": `last ${label} of the data`, "data-testid": `last-${name}` }, () => this.goLast(ns)));
    const last = element("span", { class: "last" }, element("span", { "aria-hidden": "true" }, "Last"), element("span", { class: "group" }, ...quick));
    const typed = (["from", "to"] as const).map((name) => element("label", {}, element("span", {}, name), this.fields[name]));
    const show = element("button", { type: "submit", class: "plain", "data-testid": "time-show" }, "Show");
    this.root.append(last, ...typed, show, this.zone, this.error);
    this.root.addEventListener("input", () => {
      this.edited = true;
    });
    this.root.addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
    this.root.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      this.open(false);
      this.toggle.focus();
    });
  }

  /** Takes over another window; unsubmitted input stays. */
  apply(view: View): void {
    if (!this.root.hidden && !this.edited && view.kind === "history") this.write(view);
  }

  private open(open: boolean): void {
    this.root.hidden = !open;
    this.toggle.setAttribute("aria-expanded", String(open));
    this.edited = false;
    if (!open) return;
    this.zone.textContent = `Local time, as on the charts: ${nameZone(new Date())}.`;
    this.write(this.shown());
    this.root.querySelector("button")?.focus();
  }

  private shown(): TypedRange | null {
    const { view } = this.options.context.route();
    if (view.kind === "history") return view;
    const range = this.options.range();
    if (range === null) return null;
    // A live window moves, so whole seconds are enough.
    const { timeline } = this.options.context;
    const [x0, x1] = [Math.floor(range.x0 / SECOND) * SECOND, Math.ceil(range.x1 / SECOND) * SECOND];
    return { from: timeline.toInstant(x0), to: timeline.toInstant(x1) };
  }

  private write(range: TypedRange | null): void {
    for (const name of ["from", "to"] as const) this.fields[name].value = range === null ? "" : printTypedInstant(range[name]);
    this.showError(null);
  }

  private submit(): void {
    const read = readTypedRange(this.fields.from.value, this.fields.to.value);
    if ("field" in read) this.showError(read);
    else this.go(read);
  }

  /** "Last" is meant of the data, as in the live window: a node's clock need not be ours. */
  private goLast(ns: bigint): void {
    const extent = this.options.extent();
    if (extent === null) {
      this.showError({ field: null, text: "There is no data yet." });
      return;
    }
    const to = this.options.context.timeline.toInstant(Math.ceil(extent.x1));
    this.go({ from: to - ns, to });
  }

  private go({ from, to }: TypedRange): void {
    const { context } = this.options;
    this.edited = false;
    // Straight to these instants, with a step to go back to, as to a peak that is opened.
    context.go({ ...context.route(), view: { kind: "history", from, to } });
    context.announce(`Showing ${printTypedInstant(from)} to ${printTypedInstant(to)}.`);
  }

  private showError(wrong: RefusedRange | { readonly field: null; readonly text: string } | null): void {
    this.error.textContent = wrong?.text ?? "";
    for (const name of ["from", "to"] as const) this.fields[name].setAttribute("aria-invalid", String(wrong?.field === name));
    if (wrong?.field) this.fields[wrong.field].focus();
  }
}
