import type { LayoutItem } from "../api/contract";
import { formatInterval } from "../interval/format";
import { taxelsOf, type Taxels } from "../skin/layout";
import { emptyPicture, type Picture, type Stretches } from "../skin/stretches";
import { printRoute } from "../state/route";
import { Throttle, TEXT_MS } from "../time/throttle";
import type { Context } from "./context";
import { element, setText } from "./element";

const ROW_PX = 26;
/** Rows that are made beyond what can be seen. */
const SPARE = 4;
/** A list of no more channels than this is open from the start, unless all stands in one column. */
const FEW = 100;
const NARROW_PX = 900;

/** One quantity's channels: only the rows that can be seen are made. */
class ChannelGroup {
  readonly root: HTMLDetailsElement;
  private readonly count = element("span", { class: "count" });
  private readonly rows = element("div", { class: "channel-rows" });
  private readonly scroller: HTMLElement;
  private readonly picture: Picture;
  /** Numbers of the taxels that the filter lets through. */
  private shown: readonly number[];
  private values: readonly (readonly [taxel: number, value: HTMLElement])[] = [];
  private drawn = "";

  constructor(private readonly context: Context, private readonly group: Taxels, open: boolean) {
    this.shown = [...group.taxels.keys()];
    this.picture = emptyPicture(group);
    const name = group.quantity.replaceAll("_", " ");
    this.scroller = element("div", { class: "channel-scroller", role: "group", "aria-label": `channels of ${name}` }, this.rows);
    this.scroller.addEventListener("scroll", () => this.draw(), { passive: true });
    this.root = element("details", { class: "channel-group", open, "aria-label": name, "data-testid": "channel-group", "data-quantity": group.quantity }, element("summary", {}, element("b", {}, name), this.count), this.scroller);
    this.root.addEventListener("toggle", () => this.draw());
  }

  /** Shows only channels whose names contain all words. */
  filter(words: readonly string[]): void {
    const { taxels, quantity } = this.group;
    const all = [...taxels.keys()];
    this.shown = words.length === 0 ? all : all.filter((k) => words.every((word) => `${taxels[k]}.${quantity}`.toLowerCase().includes(word)));
    setText(this.count, this.shown.length === taxels.length ? taxels.length.toLocaleString("en") : `${this.shown.length.toLocaleString("en")} of ${taxels.length.toLocaleString("en")}`);
    this.root.hidden = this.shown.length === 0;
    this.drawn = "";
    this.scroller.scrollTop = 0;
    this.draw();
  }

  draw(): void {
    if (!this.root.open) return;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_PX) - SPARE);
    const last = Math.min(this.shown.length, Math.ceil((this.scroller.scrollTop + this.scroller.clientHeight) / ROW_PX) + SPARE);
    const name = `${first} ${last} ${this.shown[first] ?? ""} ${this.shown.length}`;
    if (name === this.drawn) return;
    this.drawn = name;
    this.rows.style.height = `${this.shown.length * ROW_PX}px`;
    const focused = document.activeElement?.getAttribute("data-channel");
    const { quantity, taxels, nodes } = this.group;
    const route = { ...this.context.route(), question: null };
    const values: [number, HTMLElement][] = [];
    this.rows.replaceChildren(
      ...this.shown.slice(first, last).map((taxel, index) => {
        const channel = `${taxels[taxel]}.${quantity}`;
        const value = element("span", { class: "channel-value" });
        values.push([taxel, value]);
        const row = element("a", { class: "channel-row", href: printRoute({ ...route, node: nodes[taxel]!, channel }), "data-testid": "channel-row", "data-channel": channel }, element("span", {}, channel), value);
        row.style.transform = `translateY(${(first + index) * ROW_PX}px)`;
        return row;
      }),
    );
    this.values = values;
    if (focused) this.rows.querySelector<HTMLElement>(`[data-channel="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
  }

  /** Writes the newest interval of each row that is made; null: none is known. */
  write(stretches: Stretches | null): void {
    if (!this.root.open || this.root.hidden || this.values.length === 0) return;
    const { group, picture } = this;
    if (stretches !== null) stretches.readNewest(group, picture);
    for (const [taxel, value] of this.values) {
      const [lo, hi] = stretches === null ? [-Infinity, Infinity] : [picture.lo[taxel]!, picture.hi[taxel]!];
      setText(value, lo === -Infinity && hi === Infinity ? "–" : formatInterval({ lo, hi }, group.unit));
    }
  }
}

/** All channels of a node with their newest values, grouped by quantity and filtered by text. */
export class ChannelBrowser {
  readonly root: HTMLDetailsElement;
  private readonly input = element("input", { type: "search", placeholder: "filter, such as t01 pressure", "aria-label": "filter channels", "data-testid": "channel-filter" });
  private readonly list = element("div", { class: "channel-groups" });
  private readonly none = element("p", { class: "quiet", hidden: true }, "No channel has all of these words in its name.");
  private readonly title = element("span");
  private readonly texts = new Throttle(TEXT_MS);
  private groups: ChannelGroup[] = [];

  constructor(private readonly context: Context) {
    const body = element("div", { class: "channel-browser-body" }, this.input, this.list, this.none);
    this.root = element("details", { class: "channel-browser", hidden: true, "aria-label": "channels", "data-testid": "channel-browser" }, element("summary", {}, this.title), body);
    this.root.addEventListener("toggle", () => this.filter());
    this.input.addEventListener("input", () => this.filter());
  }

  /** Lists the channels of a layout. */
  show(layout: LayoutItem): void {
    const quantities = [...new Set(layout.patches.map(({ quantity }) => quantity))];
    const groups = quantities.map((quantity) => taxelsOf(layout, quantity));
    const total = groups.reduce((sum, { taxels }) => sum + taxels.length, 0);
    this.root.hidden = false;
    setText(this.title, `All ${total.toLocaleString("en")} channels`);
    this.groups = groups.map((group, index) => new ChannelGroup(this.context, group, total <= FEW || index === 0));
    this.list.classList.toggle("few", total <= FEW);
    this.list.replaceChildren(...this.groups.map(({ root }) => root));
    this.root.open ||= total <= FEW && innerWidth > NARROW_PX;
    this.filter();
  }

  /** Whether values are shown. */
  get open(): boolean {
    return this.root.open;
  }

  frame(at: number, stretches: Stretches | null): void {
    if (!this.root.open || !this.texts.due(at)) return;
    for (const group of this.groups) {
      group.draw();
      group.write(stretches);
    }
  }

  private filter(): void {
    const words = this.input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of this.groups) group.filter(words);
    this.none.hidden = this.groups.length === 0 || this.groups.some(({ root }) => !root.hidden);
  }
}
