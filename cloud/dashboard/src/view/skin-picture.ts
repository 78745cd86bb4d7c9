import type { ChannelItem, LiveBlock, TaxelItem } from "../api/contract";
import { isAbort } from "../api/error";
import { decimalExponent } from "../interval/decimal";
import { formatInterval } from "../interval/format";
import type { Interval } from "../interval/interval";
import { parseTyped, shortTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import type { LiveEdge } from "../live/edge";
import { hullOf, LatestValues } from "../skin/latest-values";
import { type Contact, judge, layOut, levelOf, PITCH, quantitiesOf } from "../skin/taxels";
import { printRoute, type View } from "../state/route";
import { formatDuration } from "../time/duration";
import { Throttle, TEXT_MS } from "../time/throttle";
import type { Context } from "./context";
import { element, setText } from "./element";

/** Input of a level, in the prefix of its magnitude. */
export class LevelField {
  readonly root: HTMLElement;
  value = 0;
  private exponent = 0;
  private readonly input = element("input", { type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": "level", "data-testid": "skin-level" });
  private readonly unit = element("span", { class: "unit" });

  constructor(onChange: () => void) {
    this.root = element("span", { class: "with-unit" }, this.input, this.unit);
    this.input.addEventListener("input", () => {
      const typed = parseTyped(this.input.value, this.exponent);
      this.input.setAttribute("aria-invalid", String(typed === null));
      if (typed === null) return;
      this.value = typed;
      onChange();
    });
  }

  /** Shows a level in its unit. */
  set(level: number, code: string): void {
    const unit = findUnit(code);
    const prefix = choosePrefix(unit, level === 0 ? 0 : decimalExponent(Math.abs(level)));
    this.exponent = prefix.exponent;
    // Three digits are shown, and those are meant.
    const { text, value } = shortTyped(level, prefix.exponent, 3);
    this.value = value;
    this.input.value = text;
    this.input.setAttribute("aria-invalid", "false");
    this.unit.textContent = `${prefix.symbol}${unit.symbol}`;
  }
}

const SPACE = "http://www.w3.org/2000/svg";

function svgElement(tag: string, attributes: Readonly<Record<string, string | number>>): SVGElement {
  const made = document.createElementNS(SPACE, tag) as SVGElement;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  return made;
}

/** An empty picture of a skin. */
export function drawing(width: number, height: number): SVGSVGElement {
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, class: "skin-map", role: "group" });
  svg.style.aspectRatio = `${width} / ${height}`;
  return svg as SVGSVGElement;
}

/**
 * A taxel: a disc when its contact is certain, a dashed ring with a dot when it is possible, a small
 * ring when there is none, a cross when nothing is known. The style sheet shows one shape of them.
 */
export function taxelMark(taxel: string, at: { x: number; y: number; radius: number }): SVGElement {
  const { x, y, radius } = at;
  const mark = svgElement("a", { class: "taxel-mark" });
  mark.dataset["testid"] = "taxel";
  mark.dataset["taxel"] = taxel;
  const cross = 0.35 * radius;
  mark.append(
    svgElement("title", {}),
    svgElement("circle", { class: "ground", cx: x, cy: y, r: radius }),
    svgElement("circle", { class: "shape certain", cx: x, cy: y, r: 0.86 * radius }),
    svgElement("circle", { class: "shape possible", cx: x, cy: y, r: 0.74 * radius }),
    svgElement("circle", { class: "shape possible dot", cx: x, cy: y, r: 0.28 * radius }),
    svgElement("circle", { class: "shape impossible", cx: x, cy: y, r: 0.3 * radius }),
    svgElement("path", { class: "shape unknown", d: `M${x - cross} ${y - cross} l${2 * cross} ${2 * cross} m0 ${-2 * cross} l${-2 * cross} ${2 * cross}` }),
  );
  return mark;
}

const REPAINT_MS = 100;
const RETRY_MS = 4_000;
const SETTLE_MS = 250;
/** In the past, what is shown is what was measured in so many ns before the window's end. */
const LOOK_BACK = 250_000_000n;
/** A taxel is drawn no larger, so that few of them leave room for the charts. */
const TAXEL_PX = 80;

/** A node's skin as a picture: each taxel where it sits, touched certainly, possibly or not. */
export class SkinPicture {
  readonly root = element("figure", { class: "skin", hidden: true, "data-testid": "skin" });
  private readonly summary = element("figcaption", { class: "skin-summary", "data-testid": "skin-summary" });
  private readonly choice = element("select", { "aria-label": "quantity", "data-testid": "skin-quantity" });
  private readonly level: LevelField;
  private readonly present: LatestValues;
  /** What was measured at the end of a window in the past. */
  private readonly past = new Map<string, Interval>();
  private readonly marks = new Map<string, SVGElement>();
  private channels: readonly ChannelItem[] = [];
  private taxels: readonly TaxelItem[] = [];
  private loading = new AbortController();
  private timer: ReturnType<typeof setTimeout> | null = null;
  private retry: ReturnType<typeof setTimeout> | null = null;
  private readonly beat = new Throttle(REPAINT_MS);
  private readonly texts = new Throttle(TEXT_MS);
  private view: View;

  constructor(private readonly context: Context, private readonly node: string, edge: LiveEdge) {
    this.view = context.route().view;
    this.root.setAttribute("aria-label", `skin of ${node}`);
    this.present = new LatestValues(context.timeline, edge);
    this.level = new LevelField(() => this.paint());
    this.choice.addEventListener("change", () => this.choose());
    void this.load();
  }

  /** Takes over the list of channels, once it is known or has grown. */
  show(channels: readonly ChannelItem[]): void {
    this.channels = channels;
    this.offer();
  }

  /** Shows another window: the newest data, or the past at the window's end. */
  apply(view: View): void {
    const before = this.view;
    this.view = view;
    if (view.kind === "live" && before.kind === "live") return;
    this.present.clear();
    this.past.clear();
    if (this.timer !== null) clearTimeout(this.timer);
    if (view.kind === "history") this.timer = setTimeout(() => void this.look(), SETTLE_MS);
  }

  /** Takes a live block. */
  take(block: LiveBlock, at: number): void {
    if (this.view.kind === "live") this.present.take(block, at);
  }

  frame(at: number): void {
    if (!this.root.hidden && this.beat.due(at)) this.paint(this.texts.due(at));
  }

  destroy(): void {
    this.loading.abort();
    for (const timer of [this.timer, this.retry]) if (timer !== null) clearTimeout(timer);
  }

  private async load(): Promise<void> {
    try {
      this.taxels = await this.context.client.taxels(this.node, this.loading.signal);
    } catch (error) {
      if (isAbort(error)) return;
      // The charts below show the same failure; both retry.
      this.retry = setTimeout(() => void this.load(), RETRY_MS);
      return;
    }
    this.offer();
  }

  /** Offers the quantities that the skin has, and draws it, where it has any. */
  private offer(): void {
    const quantities = quantitiesOf(this.channels, new Set(this.taxels.map(({ id }) => id)));
    const shown = [...this.choice.options].map(({ value }) => value);
    if (quantities.length === 0 || quantities.join() === shown.join()) return;
    this.choice.replaceChildren(...quantities.map((name) => element("option", { value: name }, name.replaceAll("_", " "))));
    const controls = element("div", { class: "fields" }, "Touched where", this.choice, "is above", this.level.root);
    this.root.replaceChildren(controls, this.draw(), this.summary);
    this.root.hidden = false;
    this.choose();
  }

  private choose(): void {
    const channel = this.channels.find(({ quantity }) => quantity === this.choice.value);
    this.level.set(levelOf(this.channels, this.choice.value), channel?.unit ?? "1");
    if (this.view.kind === "history") void this.look();
    this.paint();
  }

  private draw(): SVGSVGElement {
    const { spots, width, height } = layOut(this.taxels);
    const svg = drawing(width, height);
    svg.style.maxWidth = `${Math.ceil(TAXEL_PX * (width / PITCH))}px`;
    svg.setAttribute("aria-label", `The skin of ${this.node}: ${spots.length} taxels`);
    this.marks.clear();
    for (const { taxel, x, y } of spots) {
      const mark = taxelMark(taxel, { x, y, radius: 0.42 * PITCH });
      mark.addEventListener("click", (event) => {
        event.preventDefault();
        this.context.go({ ...this.context.route(), node: this.node, channel: this.channelOf(taxel), question: null });
      });
      this.marks.set(taxel, mark);
      svg.append(mark);
    }
    return svg;
  }

  private channelOf(taxel: string): string {
    return `${taxel}.${this.choice.value}`;
  }

  /** Asks what was measured at the end of a window in the past. */
  private async look(): Promise<void> {
    const { view } = this;
    if (view.kind !== "history") return;
    const window = { start: view.to - LOOK_BACK, end: view.to, points: 1 };
    const names = new Set(this.channels.map(({ id }) => id));
    const wanted = this.taxels.map(({ id }) => this.channelOf(id)).filter((channel) => names.has(channel));
    const ask = async (channel: string): Promise<void> => {
      const interval = hullOf(await this.context.client.series({ node: this.node, channel }, window, this.loading.signal));
      if (this.view === view && interval !== null) this.past.set(channel, interval);
    };
    // What cannot be had stays unknown, which the picture shows.
    await Promise.allSettled(wanted.map(ask));
    this.paint();
  }

  private paint(texts = true): void {
    const counts: Record<Contact, number> = { certain: 0, possible: 0, impossible: 0, unknown: 0 };
    const now = performance.now();
    const live = this.view.kind === "live";
    const unit = this.channels.find(({ quantity }) => quantity === this.choice.value)?.unit ?? "1";
    for (const [taxel, mark] of this.marks) {
      const channel = this.channelOf(taxel);
      const interval = live ? this.present.of(channel, now) : (this.past.get(channel) ?? null);
      const contact = judge(interval, this.level.value);
      counts[contact] += 1;
      if (mark.dataset["contact"] !== contact) mark.dataset["contact"] = contact;
      if (!texts) continue;
      const href = printRoute({ ...this.context.route(), node: this.node, channel, question: null });
      if (mark.getAttribute("href") !== href) mark.setAttribute("href", href);
      const text = `${taxel}: ${contact}${interval ? `, ${formatInterval(interval, unit)}` : ""}`;
      if (mark.getAttribute("aria-label") !== text) {
        mark.setAttribute("aria-label", text);
        mark.querySelector("title")!.textContent = text;
      }
    }
    const unknown = counts.unknown > 0 ? `, ${counts.unknown} unknown` : "";
    const { age } = this.present;
    const late = live && age !== null ? ` Data arrives at least ${formatDuration(age, "down")} late.` : "";
    setText(this.summary, `Contact: ${counts.certain} certain, ${counts.possible} possible, ${counts.impossible} impossible${unknown}.${late}`);
  }
}
