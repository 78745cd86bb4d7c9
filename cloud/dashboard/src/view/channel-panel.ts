import type { ChannelItem, EventItem } from "../api/contract";
import { isAbort } from "../api/error";
import { LatestRequest } from "../api/latest-request";
import { type Answers, BandChart, NO_ANSWERS } from "../chart/band-chart";
import type { PeakMark } from "../chart/peaks";
import { describeHull } from "../chart/reading";
import type { VerdictStretch } from "../chart/verdict-stretches";
import { VerdictStrip } from "../chart/verdict-strip";
import { formatCoverage, formatInterval } from "../interval/format";
import { Backfill } from "../live/backfill";
import { ChannelData } from "../live/channel-data";
import type { LiveEdge } from "../live/edge";
import { printRoute, type View } from "../state/route";
import type { Range } from "../state/window";
import { Throttle, TEXT_MS } from "../time/throttle";
import { type Entries, hullWithin } from "../tube/entries";
import { ChannelNotices } from "./channel-notices";
import type { Context } from "./context";
import { element, icon, setText, setTitle } from "./element";
import { addShortcuts } from "./shortcuts";
import { ICONS } from "./symbol";

export interface PanelHeadOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: ChannelItem;
  readonly alone: boolean;
  /** Where the panel writes its interval. */
  readonly value: HTMLElement;
}

function channelLink(options: PanelHeadOptions, name: readonly HTMLElement[]): HTMLElement {
  const { context, node, channel } = options;
  const href = (): string => printRoute({ ...context.route(), node, channel: channel.id, question: null });
  const link = element("a", { href: href(), "data-testid": "channel-link" }, ...name, icon(ICONS.open));
  for (const type of ["pointerenter", "focus", "click"]) {
    // The window may have changed since the link was written.
    link.addEventListener(type, () => link.setAttribute("href", href()));
  }
  return element("h3", {}, link);
}

/** A panel's title, present interval and coverage. */
export function panelHead(options: PanelHeadOptions): HTMLElement {
  const { channel, alone, value } = options;
  const name = [
    element("span", { class: "taxel" }, channel.taxel),
    element("span", {}, channel.quantity.replaceAll("_", " ")),
  ];
  const title = alone ? element("h2", {}, ...name) : channelLink(options, name);
  const meaning = "How often the interval encloses the truth, for each sample";
  const coverage = element("span", { class: "coverage", title: meaning }, `coverage ${formatCoverage(channel.coverage)}`);
  return element("header", { class: "panel-head" }, title, value, coverage);
}

/** What a panel's chart stands in, and is worked through by keys. */
export function chartRoot(node: string, channel: string): HTMLElement {
  const keys = "Arrows pan, plus and minus zoom, comma and full stop read values, L goes live.";
  const label = `Chart of ${node} ${channel}. ${keys}`;
  const data = { "data-testid": "chart", "data-node": node, "data-channel": channel };
  return element("div", { class: "chart", tabindex: 0, role: "group", "aria-label": label, ...data });
}

export interface PanelOptions {
  readonly context: Context;
  readonly node: string;
  readonly channel: ChannelItem;
  readonly edge: LiveEdge;
  readonly alone: boolean;
  readonly onPeak: (mark: PeakMark) => void;
}

const REFRESH_MS = 2_000;
/** How often the window is filled anew while the stream leaves frames out, in ms. */
const REFILL_MS = 2_000;
const MOST_POINTS = 20_000;

/** One channel: its name, its present interval, and its chart, live or in history. */
export class ChannelPanel {
  readonly root: HTMLElement;
  readonly data: ChannelData;
  answers: Answers = NO_ANSWERS;
  private readonly chart: BandChart;
  private readonly strip: VerdictStrip;
  private readonly chartRoot: HTMLElement;
  private readonly value = element("span", { class: "value", "data-testid": "channel-value" });
  private readonly notices = new ChannelNotices();
  private view: View;
  private visible = false;
  private readonly backfill: Backfill;
  private readonly requests = new LatestRequest({ ask: (signal) => this.load(signal), onIdle: () => this.settle(), now: () => performance.now() });
  private drawnEdge = Number.NaN;
  private dirty = true;
  private readonly texts = new Throttle(TEXT_MS);
  private reloadAt = 0;
  /** Whether the stream brought data of the shown history since it was loaded. */
  private outdated = false;
  /** Whether the stream left out frames that the live window lacks still. */
  private lacking = false;
  private readonly refills = new Throttle(REFILL_MS);
  private readonly watcher: IntersectionObserver;

  constructor(private readonly options: PanelOptions) {
    const { context, node, channel, edge } = options;
    this.chartRoot = chartRoot(node, channel.id);
    this.view = context.route().view;
    this.data = new ChannelData({ client: context.client, timeline: context.timeline, node, channel, edge });
    this.backfill = new Backfill({
      data: this.data,
      edge,
      width: () => this.chart.width,
      onFilled: () => {
        this.dirty = true;
        this.notices.shown();
      },
      onFailure: (error) => this.fail(error),
    });
    this.strip = new VerdictStrip(context.timeline, context.palette);
    this.root = element("section", { class: "panel", "data-testid": "channel", "data-channel": channel.id }, panelHead({ context, node, channel, alone: options.alone, value: this.value }), element("div", { class: "chart-frame" }, this.chartRoot, this.notices.root), this.strip.root);
    this.chart = new BandChart({
      root: this.chartRoot,
      timeline: context.timeline,
      palette: context.palette,
      facts: this.data.facts,
      alone: options.alone,
      dragPans: context.dragPans,
      onRange: (range) => context.showRange(range),
      onPeak: options.onPeak,
    });
    addShortcuts(this.chartRoot, {
      context,
      target: { node, channel: channel.id },
      range: () => this.range(),
      step: (by) => this.chart.step(by),
    });
    this.watcher = new IntersectionObserver((changes) => this.setVisible(changes.at(-1)?.isIntersecting ?? false), { rootMargin: "120px" });
    this.watcher.observe(this.root);
  }

  /** Shows another window, live or fixed. */
  apply(view: View): void {
    const before = this.view;
    this.view = view;
    this.dirty = true;
    if (!this.visible) return;
    if (view.kind === "live") {
      if (before.kind !== "live" || before.span !== view.span) this.startLive();
      return;
    }
    if (before.kind === "live") {
      this.backfill.stop();
      this.data.freeze();
    }
    this.look();
  }

  /** Takes live samples of this channel. */
  take(run: Entries, at: number): void {
    const { taken, hole } = this.data.take(run, at, this.visible ? this.grain() : null);
    if (!this.visible) return;
    if (this.view.kind === "live") {
      this.dirty = true;
      this.notices.arrived();
      if (hole && !this.lacking) this.backfill.fillHole(hole, this.view.span);
    } else if (taken && this.touchesView(taken)) this.outdated = true;
  }

  /** The stream has left frames out. A stream that is too slow does so many times a second: the store is asked once for all. */
  takeSkipped(): void {
    this.outdated = true;
    this.lacking = true;
  }

  /** Takes a peak or a gap; one of no channel concerns the whole node. */
  takeEvent(event: EventItem): void {
    if (event.channel !== null && event.channel !== this.options.channel.id) return;
    this.data.takeEvent(event, this.view.kind === "live" ? null : this.range());
    this.touch();
  }

  /** Shows the verdicts of a formula under the chart; none hide them. */
  showVerdicts(stretches: readonly VerdictStretch[]): void {
    this.strip.take(stretches);
    this.dirty = true;
  }

  /** Marks have changed: paint at the next frame. */
  touch(): void {
    this.dirty = true;
  }

  /** Paints the window, if its marks have changed or a live one has moved by a pixel. */
  frame(at: number): void {
    if (!this.visible) return;
    if (this.notices.retryDue(at)) this.again();
    if (this.view.kind === "history" && this.outdated && !this.requests.busy && at - this.reloadAt > REFRESH_MS) {
      this.reloadAt = at;
      this.ask();
    }
    if (this.view.kind === "history" && this.dirty) this.showHistory();
    // A live chart stands still during a drag, so that the user selects what is shown.
    if (this.view.kind === "history" || this.chart.busy) return;
    const { span } = this.view;
    if (this.lacking && this.refills.due(at)) {
      this.lacking = false;
      this.backfill.fillWindow(span);
    }
    const x1 = this.options.edge.at(at, span);
    if (x1 === null) return;
    const moved = !(Math.abs(x1 - this.drawnEdge) < span / this.chart.width / 2);
    if (!moved && !this.dirty) return;
    this.drawnEdge = x1;
    this.dirty = false;
    this.data.evictBefore(x1 - 1.5 * span);
    const settled = this.texts.due(at);
    this.draw({ x0: x1 - span, x1 }, settled);
    if (settled) this.readOut(at, x1);
  }

  repaint(): void {
    this.chart.repaint();
    this.strip.repaint();
  }

  /** How many pixels of the page the chart is wide. */
  get width(): number {
    return Math.max(2, Math.min(MOST_POINTS, Math.round(this.chart.width)));
  }

  /** The window that the chart shows now, or null before there is data. */
  range(): Range | null {
    const { timeline } = this.options.context;
    if (this.view.kind === "history") return { x0: timeline.toX(this.view.from), x1: timeline.toX(this.view.to) };
    return Number.isNaN(this.drawnEdge) ? null : { x0: this.drawnEdge - this.view.span, x1: this.drawnEdge };
  }

  destroy(): void {
    this.watcher.disconnect();
    this.requests.stop();
    this.backfill.stop();
    this.chart.destroy();
  }

  /** The finest that a live chart can show, in ns: half a pixel. */
  private grain(): number {
    return this.view.kind === "live" ? this.view.span / this.chart.width / 2 : 0;
  }

  private setVisible(visible: boolean): void {
    if (visible === this.visible) return;
    this.visible = visible;
    if (!visible) this.stopLive();
    else if (this.view.kind === "live") this.startLive();
    else this.look();
  }

  private stopLive(): void {
    this.requests.stop();
    this.backfill.stop();
    this.settle();
    this.data.clear();
    this.drawnEdge = Number.NaN;
  }

  /** Starts the live window afresh from the store; a window of the past is asked for again. */
  private startLive(): void {
    this.outdated = true;
    this.lacking = false;
    if (!this.visible || this.view.kind !== "live") return;
    this.stopLive();
    this.chart.resetValues();
    this.chartRoot.dataset["mode"] = "live";
    if (this.data.end === null) {
      this.notices.noData(this.options.channel.id);
      return;
    }
    this.notices.loading();
    this.backfill.fillWindow(this.view.span);
  }

  private showHistory(): void {
    const range = this.range();
    if (range === null || this.view.kind !== "history") return;
    this.dirty = false;
    this.chartRoot.dataset["mode"] = "history";
    this.draw(range, true);
    setText(this.value, describeHull(this.data.history, range, this.data.facts.unit));
    setTitle(this.value, "The hull of everything in this window");
  }

  /** Shows what is known of a history window, and loads the rest; the request goes first. */
  private look(): void {
    const range = this.range();
    if (range !== null && this.data.holds(range)) {
      this.requests.stop();
      this.settle();
      this.present(range);
    } else {
      this.notices.asking();
      this.ask();
      this.showHistory();
    }
  }

  private settle(): void {
    this.root.classList.remove("busy");
  }

  /** Shows a window of the past of which all is known. */
  private present(range: Range): void {
    if (!this.chart.busy) this.chart.resetValues();
    this.chartRoot.dataset["resolution"] = this.data.resolution;
    this.showHistory();
    this.sayWhatIsThere(range);
  }

  /** Asks the store for the window. */
  private ask(): void {
    this.root.classList.add("busy");
    this.requests.ask();
  }

  private async load(signal: AbortSignal): Promise<void> {
    const range = this.range();
    if (range === null || this.view.kind !== "history") return;
    this.outdated = false;
    try {
      await this.data.load(range, this.width, signal);
      if (this.view.kind !== "history") return;
      this.present(range);
    } catch (error) {
      this.fail(error);
    }
  }

  private sayWhatIsThere(range: Range): void {
    const { extent } = this.data;
    if (hullWithin(this.data.history, range.x0, range.x1).count > 0) this.notices.shown();
    else if (extent === null) this.notices.noData(this.options.channel.id);
    else this.notices.noSamples(() => this.options.context.showRange(extent));
  }

  private touchesView(range: Range): boolean {
    const shown = this.range();
    return shown !== null && range.x1 >= shown.x0 && range.x0 <= shown.x1;
  }

  private draw(range: Range, settled: boolean): void {
    const { peaks, gaps, rolling, history } = this.data;
    this.chart.show(this.view.kind === "live" ? rolling : history, { ...this.answers, peaks, gaps }, range, settled);
    this.strip.show(range, this.chart.place);
  }

  private readOut(at: number, x1: number): void {
    const { t, width, lo, hi } = this.data.rolling;
    let last = t.length - 1;
    while (last > 0 && t[last]! + width[last]! > x1) last -= 1;
    const interval = last < 0 ? null : { lo: lo[last]!, hi: hi[last]! };
    setText(this.value, interval ? formatInterval(interval, this.data.facts.unit) : "–");
    setTitle(this.value, "The newest interval");
    const silent = this.data.silentSince(at);
    this.notices.silent(silent === null ? null : this.options.context.timeline.toInstant(silent));
  }

  private fail(error: unknown): void {
    if (!isAbort(error)) this.notices.fail(error, () => this.again());
  }

  /** Asks again for what could not be had. */
  private again(): void {
    if (this.view.kind === "live") this.backfill.fillWindow(this.view.span);
    else this.ask();
  }
}
