import type { ChannelItem, LiveBlock, TaxelItem } from "../api/contract";
import { isAbort } from "../api/failure";
import { formatInterval } from "../interval/format";
import type { Interval } from "../interval/interval";
import type { LiveEdge } from "../live/edge";
import { judge, levelOf, quantitiesOf, type Contact } from "../skin/contact";
import { layOut, PITCH } from "../skin/layout";
import { hullOf, Present } from "../skin/present";
import { printPlace, type View } from "../state/place";
import { Beat, TEXT_MS } from "../time/beat";
import { formatDuration } from "../time/duration";
import type { Context } from "./context";
import { element, setText } from "./element";
import { LevelField } from "./level-field";
import { drawing, taxelMark } from "./taxel-mark";

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
  private readonly present: Present;
  /** What was measured at the end of a window in the past. */
  private readonly past = new Map<string, Interval>();
  private readonly marks = new Map<string, SVGElement>();
  private channels: readonly ChannelItem[] = [];
  private taxels: readonly TaxelItem[] = [];
  private loading = new AbortController();
  private timer: ReturnType<typeof setTimeout> | null = null;
  private retry: ReturnType<typeof setTimeout> | null = null;
  private readonly beat = new Beat(REPAINT_MS);
  private readonly texts = new Beat(TEXT_MS);
  private view: View;

  constructor(private readonly context: Context, private readonly node: string, edge: LiveEdge) {
    this.view = context.place().view;
    this.root.setAttribute("aria-label", `skin of ${node}`);
    this.present = new Present(context.timeline, edge);
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
      // The charts beneath tell of the same failure; they list their channels again, and so does this.
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
        this.context.go({ ...this.context.place(), node: this.node, channel: this.channelOf(taxel), question: null });
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
    const counts: Record<Contact, number> = { certain: 0, possible: 0, none: 0, unknown: 0 };
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
      const href = printPlace({ ...this.context.place(), node: this.node, channel, question: null });
      if (mark.getAttribute("href") !== href) mark.setAttribute("href", href);
      const text = `${taxel}: ${contact}${interval ? `, ${formatInterval(interval, unit)}` : ""}`;
      if (mark.getAttribute("aria-label") !== text) {
        mark.setAttribute("aria-label", text);
        mark.querySelector("title")!.textContent = text;
      }
    }
    const unknown = counts.unknown > 0 ? `, ${counts.unknown} unknown` : "";
    const { age } = this.present;
    const late = live && age !== null ? ` What comes was measured at least ${formatDuration(age, "down")} ago.` : "";
    setText(this.summary, `Contact: ${counts.certain} certain, ${counts.possible} possible, ${counts.none} none${unknown}.${late}`);
  }
}
