import type { Client, MonitorDefinition } from "../api/client";
import type { AlarmItem, MonitorItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { type Route, printRoute } from "../state/route";
import { type Instant, parseInstant, printClock, printDay } from "../time/instant";
import { button, element } from "./element";
import { totalsAnswer, type Wording } from "./question-parts";
import { verdictSymbol } from "./symbol";

const AROUND = 10_000_000_000n;
const DAY = 86_400_000_000_000n;
const SILENCE_S = 3_600;
const MOST_CARDS = 8;
/** A channel of the monitor's own node within a formula. */
const CHANNEL = /(?<![\w/".-])([a-z][\w-]*\.[a-z][\w-]*)/;

/** Where an alarm is looked at: its formula over the time around its begin. */
export function alarmRoute(alarm: AlarmItem, monitor: MonitorItem | undefined): Route {
  const began = parseInstant(alarm.began);
  const ended = alarm.ended === null ? began : parseInstant(alarm.ended);
  const view = { kind: "history", from: began - AROUND, to: ended + AROUND } as const;
  const channel = monitor?.node ? (CHANNEL.exec(alarm.formula)?.[1] ?? null) : null;
  const question = channel === null ? null : ({ kind: "formula", formula: alarm.formula } as const);
  return { node: monitor?.node ?? null, channel, view, question };
}

function when(text: string, now: bigint): string {
  const instant = parseInstant(text);
  return `${now - instant > DAY / 2n ? `${printDay(instant)} ` : ""}${printClock(instant, 0)}`;
}

/** What is said of a monitor's latest verdict. */
export function monitorState(monitor: MonitorItem): string {
  if (monitor.problem !== null) return monitor.problem;
  if (monitor.latest === null) return "no verdict yet";
  return monitor.latest.missing ? "possible: samples are missing" : monitor.latest.verdict;
}

/** Alarms that are raised, on every page; and all monitors, beside all nodes. */
export class AlarmBoard {
  readonly root = element("section", { class: "alarms", "aria-label": "alarms", "data-testid": "alarms" });
  private readonly raised = element("ul", { class: "alarm-list", "aria-live": "polite" });
  private readonly rows = element("tbody");
  private readonly list: HTMLDetailsElement;
  private readonly note = element("p", { class: "answer bad", role: "alert", hidden: true, "data-testid": "alarm-note" });
  private alarms: readonly AlarmItem[] = [];
  private monitors: readonly MonitorItem[] = [];
  private drawn = "";

  constructor(private readonly client: Client) {
    const head = element("tr", {}, ...["monitor", "formula", "raises on", "verdict", ""].map((text) => element("th", { scope: "col" }, text)));
    const table = element("table", {}, element("thead", {}, head), this.rows);
    this.list = element("details", { class: "compare", "data-testid": "monitors" }, element("summary", {}, "Monitors"), element("div", { class: "scrolls" }, table));
    this.root.append(this.raised, this.note, this.list);
  }

  /** Loads what is shown; a failure keeps what was shown, as the page says that the cloud is away. */
  async load(signal: AbortSignal): Promise<void> {
    try {
      [this.alarms, this.monitors] = await Promise.all([this.client.raisedAlarms(signal), this.client.monitors(signal)]);
    } catch (error) {
      if (!isAbort(error)) return;
    }
  }

  /** Shows the alarms, and the monitors where all nodes are shown. */
  show(now: bigint, everything: boolean): void {
    const state = JSON.stringify([this.alarms, this.monitors, everything]);
    if (state === this.drawn) return;
    this.drawn = state;
    this.list.hidden = !everything || this.monitors.length === 0;
    this.root.hidden = this.alarms.length === 0 && this.list.hidden;
    const cards = this.alarms.slice(0, MOST_CARDS).map((alarm) => this.card(alarm, now));
    const more = this.alarms.length - cards.length;
    this.raised.replaceChildren(...cards, ...(more > 0 ? [element("li", {}, `and ${more.toLocaleString("en")} more`)] : []));
    this.rows.replaceChildren(...this.monitors.map((monitor) => this.row(monitor, now)));
  }

  private card(alarm: AlarmItem, now: bigint): HTMLElement {
    const monitor = this.monitors.find(({ name }) => name === alarm.monitor);
    const link = element("a", { href: printRoute(alarmRoute(alarm, monitor)), title: alarm.formula }, element("strong", {}, alarm.monitor));
    const known = alarm.acknowledged === null ? null : element("span", { class: "badge" }, `acknowledged by ${alarm.acknowledged_by ?? ""}`);
    const act = alarm.acknowledged === null ? button("Acknowledge", { class: "plain", "data-testid": "acknowledge" }, () => this.act(() => this.client.acknowledge(alarm.id))) : null;
    const silent = monitor?.silenced_until ? null : button("Silence for 1 h", { class: "plain quiet" }, () => this.act(() => this.client.silence(alarm.monitor, SILENCE_S)));
    return element(
      "li",
      { class: "alarm", "data-testid": "alarm", "data-monitor": alarm.monitor, "data-id": alarm.id },
      verdictSymbol(alarm.verdict),
      link,
      element("span", { class: "badge bad" }, alarm.escalated === null ? alarm.severity : `${alarm.severity}, escalated`),
      element("span", {}, `${alarm.verdict} since ${when(alarm.began, now)}`),
      known,
      act,
      silent,
    );
  }

  private row(monitor: MonitorItem, now: bigint): HTMLElement {
    const silenced = monitor.silenced_until !== null && parseInstant(monitor.silenced_until) > now ? `, silenced until ${when(monitor.silenced_until, now)}` : "";
    const { latest } = monitor;
    const verdict = latest !== null && latest.verdict !== "impossible" ? verdictSymbol(latest.verdict) : null;
    return element(
      "tr",
      { "data-testid": "monitor", "data-monitor": monitor.name },
      element("th", { scope: "row" }, monitor.name),
      element("td", {}, element("code", {}, monitor.formula)),
      element("td", {}, monitor.raise_on),
      element("td", { class: monitor.problem === null ? null : "warn" }, verdict, ` ${monitorState(monitor)}${silenced}`),
      element("td", {}, button("Delete", { class: "plain quiet", "aria-label": `delete the monitor ${monitor.name}` }, () => this.act(() => this.client.deleteMonitor(monitor.name)))),
    );
  }

  private act(work: () => Promise<void>): void {
    this.note.hidden = true;
    const done = async (): Promise<void> => {
      try {
        await work();
        await this.load(AbortSignal.timeout(10_000));
      } catch (error) {
        this.note.hidden = false;
        this.note.textContent = messageOf(error);
      }
    };
    void done();
  }
}

export interface WatchFormOptions {
  readonly client: Client;
  readonly node: string;
  readonly formula: () => string;
  /** Where what is stored of the channel ends; null before there is any. */
  readonly latest: () => Instant | null;
}

const HOUR = 3_600_000_000_000n;
const CHECK_MS = 30_000;
const CHECKED: Wording = {
  state: "In the last hour it held",
  never: "Impossible",
  because: () => "it held nowhere in the last hour",
  name: "checked",
};

const NAME = /^[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?$/;
/** Names that the cloud's interface has for itself. */
const TAKEN = new Set(["evaluation"]);

/** Why the cloud would refuse a monitor's name; null where it would not. */
export function nameError(name: string): string | null {
  if (TAKEN.has(name)) return `"${name}" is taken by the cloud itself; choose another name.`;
  return NAME.test(name) ? null : `"${name}" is no name: write at most 63 small letters, digits and dashes between them, such as left-grip.`;
}

/** Defines a monitor of the formula that is written, once its last hour was shown. */
export class WatchForm {
  readonly root: HTMLElement;
  private readonly name = element("input", { type: "text", placeholder: "name", "aria-label": "name of the monitor", "aria-describedby": "watch-error", autocomplete: "off", spellcheck: "false", "data-testid": "watch-name" });
  private readonly level = element("select", { "aria-label": "what raises an alarm" }, element("option", { value: "certain" }, "when certain"), element("option", { value: "possible" }, "when possible"));
  private readonly watch = element("button", { type: "submit", class: "plain", "data-testid": "watch" }, "Raise an alarm");
  private readonly error = element("p", { id: "watch-error", class: "answer bad", role: "alert", hidden: true, "data-testid": "watch-error" });
  private readonly answer = element("p", { class: "answer", role: "status", "data-testid": "watch-answer" });
  /** The formula whose last hour was shown: the next press defines a monitor of it. */
  private checked: string | null = null;
  private busy = false;

  constructor(private readonly options: WatchFormOptions) {
    const form = element("form", { class: "formula-form", "aria-label": "monitor" }, element("div", { class: "fields" }, this.name, this.level, this.watch));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.press();
    });
    this.name.addEventListener("input", () => this.judgeName());
    this.root = element("div", { class: "watch" }, form, this.error, this.answer);
  }

  /** Call when another formula is written: it was not checked. */
  reset(): void {
    if (this.checked === null) return;
    this.await(null);
    this.answer.textContent = "";
  }

  private await(formula: string | null): void {
    this.checked = formula;
    this.watch.textContent = formula === null ? "Raise an alarm" : "Raise it";
  }

  private judgeName(): boolean {
    const name = this.name.value.trim();
    const wrong = name === "" ? null : nameError(name);
    this.name.setAttribute("aria-invalid", String(wrong !== null));
    this.error.hidden = wrong === null;
    this.error.textContent = wrong;
    return wrong === null;
  }

  private async press(): Promise<void> {
    const [name, formula] = [this.name.value.trim(), this.options.formula()];
    if (name === "" || formula === "") {
      this.answer.textContent = "Write a formula above, and a name for the monitor.";
      return;
    }
    if (!this.judgeName()) {
      this.name.focus();
      return;
    }
    if (this.busy) return;
    this.busy = true;
    if (this.checked === formula) await this.define(name, formula);
    else await this.check(formula);
    this.busy = false;
  }

  /** Shows the last hour that is stored; where it cannot be shown, why, as the formula may be right nevertheless. */
  private async check(formula: string): Promise<void> {
    const { client, node, latest } = this.options;
    const [end, next] = [latest(), ' Press "Raise it" to define the monitor.'];
    this.answer.textContent = "Checking the last hour…";
    try {
      if (end === null) throw new Error("nothing is stored yet");
      const range = { x0: 0, x1: Number(HOUR) };
      const found = await client.verdictTime({ formula, node, start: end - HOUR, end }, AbortSignal.timeout(CHECK_MS));
      this.answer.replaceChildren(...totalsAnswer(found, range, { wording: CHECKED, complete: true }), next);
    } catch (error) {
      this.answer.replaceChildren(element("strong", { class: "bad" }, "Not checked"), `: ${messageOf(error)}${next}`);
    }
    this.await(formula);
  }

  private async define(name: string, formula: string): Promise<void> {
    const { client, node } = this.options;
    const definition: MonitorDefinition = { formula, node, raise_on: this.level.value };
    try {
      await client.defineMonitor(name, definition);
      this.await(null);
      this.answer.textContent = `${name} is evaluated from now on. The page of all nodes lists the monitors.`;
    } catch (error) {
      this.answer.replaceChildren(element("strong", { class: "bad" }, "Not defined"), `: ${messageOf(error)}`);
    }
  }
}
