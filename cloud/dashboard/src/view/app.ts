import type { Client } from "../api/client";
import type { NodeItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import type { Palette } from "../chart/palette";
import { FrameLoop } from "../live/frame-loop";
import { type Route, printRoute, parseRoute } from "../state/route";
import type { ThemeChoice } from "../state/theme";
import type { Range } from "../state/window";
import { Throttle } from "../time/throttle";
import type { Timeline } from "../time/timeline";
import type { Context } from "./context";
import { AlarmBoard } from "./alarm-board";
import { button, element, icon, setText } from "./element";
import { LiveStatus } from "./live-status";
import { NodeStrip } from "./node-cards";
import { Page } from "./page";
import { StackStrip } from "./stack-cards";
import { ICONS, verdictSymbol } from "./symbol";
import { Timebar } from "./timebar";

/** One line that explains how to read a chart. */
export function legend(): HTMLElement {
  return element(
    "p",
    { class: "legend", "data-testid": "legend" },
    element("span", { class: "key" }, element("i", { class: "swatch band" }), element("b", {}, "band"), " encloses the true value at every sample"),
    element("span", { class: "key" }, verdictSymbol("certain"), element("b", {}, "certain"), " holds for every value in the band"),
    element("span", { class: "key" }, verdictSymbol("possible"), element("b", {}, "possible"), " holds for some; 0–3 is how many"),
    element("span", { class: "key" }, element("i", { class: "swatch missing" }), element("b", {}, "hatched"), " nothing known"),
  );
}

export interface AppOptions {
  readonly root: HTMLElement;
  readonly client: Client;
  readonly timeline: Timeline;
  readonly palette: Palette;
  readonly theme: () => ThemeChoice;
  readonly onUnauthorised: () => void;
}

const POLL_MS = 2_000;
const STATUS_PAUSE_MS = 300;

/** The whole dashboard: header, nodes, and the page that the address names. */
export class App {
  private route: Route = parseRoute(location.hash);
  private page: Page | null = null;
  private nodes: readonly NodeItem[] | null = null;
  private dragPans = false;
  private polledAt = -Infinity;
  private polls = 0;
  /** The newest poll that was answered. */
  private answered = 0;
  private reachable = true;
  private readonly seconds = new Throttle(1_000);
  private readonly status = new LiveStatus();
  private readonly strip: NodeStrip;
  private readonly stack = new StackStrip();
  private readonly alarms: AlarmBoard;
  private readonly timebar: Timebar;
  private readonly announcer = element("div", { class: "unseen", "aria-live": "polite", "data-testid": "announcer" });
  private readonly banner = element("div", { class: "banner", hidden: true, role: "alert", "data-testid": "banner" });
  private readonly context: Context;

  constructor(private readonly options: AppOptions) {
    const { client, timeline, palette, onUnauthorised } = options;
    this.context = {
      client,
      timeline,
      palette,
      onUnauthorised,
      route: () => this.route,
      go: (route, how) => this.go(route, how ?? "push"),
      showRange: (range) => this.showRange(range),
      dragPans: () => this.dragPans,
      announce: (text) => this.announce(text),
    };
    this.strip = new NodeStrip(this.context);
    this.alarms = new AlarmBoard(client);
    this.timebar = new Timebar({
      context: this.context,
      range: () => this.page?.range() ?? null,
      extent: () => this.page?.extent() ?? null,
      onPanMode: (pans) => {
        this.dragPans = pans;
        document.body.classList.toggle("pans", pans);
      },
    });
  }

  start(): void {
    const overview = element("div", { class: "overview" }, this.strip.root, this.stack.root);
    this.options.root.replaceChildren(this.header(), this.banner, this.alarms.root, overview, this.announcer);
    addEventListener("hashchange", () => this.show(parseRoute(location.hash)));
    this.show(this.route);
    new FrameLoop((at) => this.frame(at)).start();
  }

  /** Paints everything again, after a change of theme. */
  repaint(): void {
    this.page?.repaint();
  }

  private header(): HTMLElement {
    const theme = button(icon(ICONS.moon), { class: "tool", "aria-label": "switch between light and dark", title: "Light or dark", "data-testid": "theme" }, () => this.options.theme().toggle());
    const logout = button(icon(ICONS.logout), { class: "tool", "aria-label": "log out", title: "Log out", "data-testid": "logout" }, () => void this.logout());
    const brand = element("a", { class: "brand", href: "#/" }, element("i", { class: "mark" }), "eskin");
    brand.addEventListener("click", (event) => {
      event.preventDefault();
      this.go({ ...this.route, node: null, channel: null, question: null }, "push");
    });
    const tools = element("span", { class: "tools" }, theme, logout);
    const bar = element("div", { class: "bar" }, brand, this.status.root, this.timebar.root, tools);
    return element("header", { class: "top" }, bar, this.timebar.form.root, legend());
  }

  private go(route: Route, how: "push" | "replace"): void {
    const hash = printRoute(route);
    if (how === "push") history.pushState(null, "", hash);
    else history.replaceState(null, "", hash);
    this.show(route);
  }

  private showRange(range: Range): void {
    const { timeline } = this.options;
    const view = { kind: "history", from: timeline.toInstant(range.x0), to: timeline.toInstant(Math.ceil(range.x1)) } as const;
    const how = this.route.view.kind === "live" ? "push" : "replace";
    if (how === "push") this.announce("History. Choose Live to follow the newest data again.");
    this.go({ ...this.route, view }, how);
  }

  private show(route: Route): void {
    const before = this.route;
    this.route = route;
    document.title = [route.channel, route.node, "eskin"].filter(Boolean).join(" · ");
    document.body.dataset["mode"] = route.view.kind;
    this.timebar.apply(route.view);
    if (this.page && before.node === route.node && before.channel === route.channel) this.page.apply(route);
    else this.openPage();
    this.showStrip();
  }

  private openPage(): void {
    // A keyboard user continues at the new page, not at the start of the document.
    const focused = this.page?.root.contains(document.activeElement) ?? false;
    this.page?.destroy();
    this.page = new Page({
      context: this.context,
      onFeed: (state) => this.status.show(state),
      onUnreadable: () => this.status.refuse(),
      onStatus: () => {
        this.polledAt = Math.min(this.polledAt, performance.now() - POLL_MS + STATUS_PAUSE_MS);
      },
    });
    this.options.root.append(this.page.root);
    if (focused) this.page.root.focus({ preventScroll: true });
    if (this.nodes) this.page.showNodes(this.nodes);
    scrollTo(0, 0);
  }

  private frame(at: number): void {
    this.page?.frame(at);
    this.timebar.frame(at);
    if (at - this.polledAt > POLL_MS) {
      this.polledAt = at;
      void this.poll();
    }
    if (this.seconds.due(at)) this.showStrip();
  }

  private async poll(): Promise<void> {
    this.polls += 1;
    const turn = this.polls;
    try {
      const signal = AbortSignal.timeout(10_000);
      if (this.route.node === null) void this.stack.load(this.options.client, signal).then(() => this.showStrip());
      void this.alarms.load(signal).then(() => this.showStrip());
      const nodes = await this.options.client.nodes(signal);
      if (!this.counts(turn)) return;
      this.nodes = nodes;
      this.banner.hidden = true;
      this.reachable = true;
      this.showStrip();
      this.page?.showNodes(this.nodes);
    } catch (error) {
      if (isAbort(error) || !this.counts(turn)) return;
      const again = (): void => void this.poll();
      // An unchanged text stays, or screen readers would read it out every 2 s.
      setText(this.banner, `${messageOf(error).replace(/[.!]?$/, ".")} What is shown may be out of date; trying again every 2 s.`);
      this.banner.hidden = this.page?.showFailure(messageOf(error), again) ?? false;
      this.reachable = false;
      this.showStrip();
    }
  }

  /** Whether an answer is newer than the last one taken: some take longer than others. */
  private counts(turn: number): boolean {
    if (turn < this.answered) return false;
    this.answered = turn;
    return true;
  }

  private showStrip(): void {
    const now = BigInt(Date.now()) * 1_000_000n;
    this.status.reach(this.reachable);
    if (this.nodes) this.strip.show(this.nodes, now, this.reachable);
    this.alarms.show(now, this.route.node === null);
    this.stack.root.hidden = this.route.node !== null;
    if (!this.stack.root.hidden) this.stack.show(now, this.reachable);
  }

  private announce(text: string): void {
    this.announcer.textContent = text;
  }

  private async logout(): Promise<void> {
    await this.options.client.logout();
    this.options.onUnauthorised();
  }
}
