import { SPANS, type View } from "../state/route";
import { pan, type Range, zoom } from "../state/window";
import { formatDuration } from "../time/duration";
import { decimalsFor, printClock, printDay } from "../time/instant";
import { Throttle, TEXT_MS } from "../time/throttle";
import type { Context } from "./context";
import { button, element, icon, setText } from "./element";
import { ICONS } from "./symbol";
import { TimeForm } from "./time-form";

export interface TimebarOptions {
  readonly context: Context;
  readonly range: () => Range | null;
  readonly extent: () => Range | null;
  readonly onPanMode: (pans: boolean) => void;
}

/** Live or history, how long a window, and moving through time by buttons. */
export class Timebar {
  readonly root: HTMLElement;
  /** Stands below the bar, where there is room. */
  readonly form: TimeForm;
  private readonly live = button("Live", { "data-testid": "go-live", title: "Follow the newest data (L in a chart)" }, () => this.goLive());
  private readonly span = element("select", { "aria-label": "length of the live window", "data-testid": "live-span" });
  private readonly text = element("span", { class: "window-text", "data-testid": "window-text" });
  private readonly panMode: HTMLButtonElement;
  private lastSpan = 10e9;
  private readonly texts = new Throttle(TEXT_MS);

  constructor(private readonly options: TimebarOptions) {
    for (const { label, ns } of SPANS) this.span.append(element("option", { value: ns }, label));
    this.span.addEventListener("change", () => {
      this.lastSpan = Number(this.span.value);
      this.goLive();
    });
    this.panMode = button("Pan", { "aria-pressed": "false", title: "Drag pans instead of selecting (or hold Shift)", "data-testid": "pan-mode" }, () => this.togglePan());
    this.form = new TimeForm(options);
    this.root = element(
      "div",
      { class: "timebar", role: "toolbar", "aria-label": "time" },
      element("span", { class: "group" }, this.live, this.span),
      this.form.toggle,
      element(
        "span",
        { class: "group" },
        this.tool(ICONS.left, "Earlier", (range) => pan(range, -0.5)),
        this.tool(ICONS.right, "Later", (range) => pan(range, 0.5)),
        this.tool(ICONS.plus, "Zoom in", (range) => zoom(range, 0.5, 0.5)),
        this.tool(ICONS.minus, "Zoom out", (range) => zoom(range, 0.5, 2)),
        button("All", { "data-testid": "show-all", title: "Show all data" }, () => this.move(() => options.extent())),
        this.panMode,
      ),
      this.text,
    );
  }

  /** Shows which window is chosen. */
  apply(view: View): void {
    if (view.kind === "live") this.lastSpan = view.span;
    this.span.value = String(this.lastSpan);
    this.live.setAttribute("aria-pressed", String(view.kind === "live"));
    this.form.apply(view);
    this.texts.reset();
  }

  /** Writes the window's times. */
  frame(at: number): void {
    if (!this.texts.due(at)) return;
    const range = this.options.range();
    setText(this.text, range === null ? "" : this.describe(range));
  }

  private describe(range: Range): string {
    const { timeline, route } = this.options.context;
    const length = range.x1 - range.x0;
    const [from, to] = [timeline.toInstant(range.x0), timeline.toInstant(range.x1)];
    const live = route().view.kind === "live";
    const decimals = live ? 0 : decimalsFor(length / 20);
    const day = printDay(from);
    const end = printDay(to) === day ? "" : `${printDay(to)} `;
    const lead = live ? "" : `${day} `;
    return `${lead}${printClock(from, decimals)} – ${end}${printClock(to, decimals)} · ${formatDuration(length)}`;
  }

  private tool(path: string, label: string, move: (range: Range) => Range | null): HTMLButtonElement {
    const id = label.toLowerCase().replaceAll(" ", "-");
    return button(icon(path), { class: "tool", "aria-label": label, title: label, "data-testid": id }, () => this.move(move));
  }

  private move(how: (range: Range) => Range | null): void {
    const range = this.options.range() ?? this.options.extent();
    const next = range && how(range);
    if (next) this.options.context.showRange(next);
  }

  private goLive(): void {
    const { context } = this.options;
    context.go({ ...context.route(), view: { kind: "live", span: this.lastSpan } });
  }

  private togglePan(): void {
    const pans = this.panMode.getAttribute("aria-pressed") !== "true";
    this.panMode.setAttribute("aria-pressed", String(pans));
    this.options.onPanMode(pans);
  }
}
