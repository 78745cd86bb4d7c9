import type { LayoutItem } from "../api/contract";
import { printRoute } from "../state/route";
import type { Context } from "./context";
import { element, setText } from "./element";

const ROW_PX = 26;
/** Rows that are made beyond what can be seen. */
const SPARE = 4;

interface Group {
  readonly quantity: string;
  readonly taxels: readonly string[];
}

/** One quantity's channels: only the rows that can be seen are made. */
class ChannelGroup {
  readonly root: HTMLDetailsElement;
  private readonly count = element("span", { class: "count" });
  private readonly rows = element("div", { class: "channel-rows" });
  private readonly scroller: HTMLElement;
  private shown: readonly string[];
  private drawn = "";

  constructor(private readonly context: Context, private readonly node: string, private readonly group: Group, open: boolean) {
    this.shown = group.taxels;
    const name = group.quantity.replaceAll("_", " ");
    this.scroller = element("div", { class: "channel-scroller", role: "group", "aria-label": `channels of ${name}` }, this.rows);
    this.scroller.addEventListener("scroll", () => this.draw(), { passive: true });
    this.root = element("details", { class: "channel-group", open, "data-testid": "channel-group", "data-quantity": group.quantity }, element("summary", {}, element("b", {}, name), this.count), this.scroller);
    this.root.addEventListener("toggle", () => this.draw());
  }

  /** Shows only channels whose names contain all words. */
  filter(words: readonly string[]): void {
    const { taxels, quantity } = this.group;
    this.shown = words.length === 0 ? taxels : taxels.filter((taxel) => words.every((word) => `${taxel}.${quantity}`.toLowerCase().includes(word)));
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
    const route = { ...this.context.route(), node: this.node, question: null };
    this.rows.replaceChildren(
      ...this.shown.slice(first, last).map((taxel, index) => {
        const channel = `${taxel}.${this.group.quantity}`;
        const row = element("a", { class: "channel-row", href: printRoute({ ...route, channel }), "data-testid": "channel-row", "data-channel": channel }, channel);
        row.style.transform = `translateY(${(first + index) * ROW_PX}px)`;
        return row;
      }),
    );
    if (focused) this.rows.querySelector<HTMLElement>(`[data-channel="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
  }
}

/** All channels of a node, grouped by quantity and filtered by text. */
export class ChannelBrowser {
  readonly root: HTMLElement;
  private readonly input = element("input", { type: "search", placeholder: "filter, such as t01 pressure", "aria-label": "filter channels", "data-testid": "channel-filter" });
  private readonly list = element("div", { class: "channel-groups" });
  private readonly none = element("p", { class: "quiet", hidden: true }, "No channel has all of these words in its name.");
  private readonly title = element("span");
  private groups: ChannelGroup[] = [];

  constructor(private readonly context: Context, private readonly node: string) {
    const body = element("div", { class: "channel-browser-body" }, this.input, this.list, this.none);
    const root = element("details", { class: "channel-browser", "data-testid": "channel-browser" }, element("summary", {}, this.title), body);
    root.addEventListener("toggle", () => this.filter());
    this.input.addEventListener("input", () => this.filter());
    this.root = root;
  }

  /** Lists the channels of a layout. */
  show(layout: LayoutItem): void {
    const taxels = new Map<string, string[]>();
    for (const patch of layout.patches) {
      const held = taxels.get(patch.quantity) ?? [];
      held.push(...patch.taxels);
      taxels.set(patch.quantity, held);
    }
    const total = [...taxels.values()].reduce((sum, all) => sum + all.length, 0);
    setText(this.title, `All ${total.toLocaleString("en")} channels`);
    this.groups = [...taxels].map(([quantity, all], index) => new ChannelGroup(this.context, this.node, { quantity, taxels: all }, index === 0));
    this.list.replaceChildren(...this.groups.map(({ root }) => root));
    this.filter();
  }

  private filter(): void {
    const words = this.input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of this.groups) group.filter(words);
    this.none.hidden = this.groups.length === 0 || this.groups.some(({ root }) => !root.hidden);
  }
}
