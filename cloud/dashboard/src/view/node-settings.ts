import type { CommandItem, NodeState, Setting } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { printQuantity } from "../interval/typed";
import { parseInstant, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { element, setText } from "./element";

/** A setting of a target, as desired and as the node reports it; null where unknown. */
export interface SettingRow {
  readonly target: string;
  readonly name: string;
  readonly desired: string | null;
  readonly reported: string | null;
  readonly settled: boolean;
  /** What became of the command that asked for what is desired, if the node did not do it. */
  readonly failure: "refused" | "expired" | null;
}

/** The UCUM units of channels. */
export type Units = ReadonlyMap<string, string>;

/** The target of what holds for all taxels. */
const WHOLE_NODE = "*";

/** The unit of a setting, as docs/rest.md has it. */
function unitOf(target: string, name: string, units: Units): string {
  if (name === "rate") return "Hz";
  return name === "threshold" ? (units.get(target) ?? "") : "";
}

/** A setting with its unit; a number that has none is written as it is. */
function shown(value: Setting | undefined, unit = ""): string | null {
  if (value === undefined) return null;
  return typeof value === "number" && unit !== "" ? printQuantity(value, unit) : String(value);
}

/** What became of a command that asked for what is desired of a target, if the node did not do it. */
function failureOf(command: CommandItem | null, state: NodeState, { target, name }: { target: string; name: string }): SettingRow["failure"] {
  if (command === null || (command.state !== "refused" && command.state !== "expired")) return null;
  const { channel, taxel, monitor } = command.arguments;
  const place = channel ?? taxel ?? (monitor === undefined ? WHOLE_NODE : `monitor:${monitor}`);
  const desiredOf = state.desired[target]?.[name] === undefined ? WHOLE_NODE : target;
  return place === desiredOf && command.arguments[name] !== undefined ? command.state : null;
}

/** What a node reports of a setting that is desired for all its taxels. */
function reportedOfAll(state: NodeState, name: string): string | null {
  const unit = unitOf(WHOLE_NODE, name, new Map());
  const own = state.reported?.[WHOLE_NODE]?.[name];
  if (own !== undefined) return shown(own, unit);
  const found = Object.entries(state.reported ?? {})
    .filter(([target]) => state.desired[target]?.[name] === undefined)
    .map(([target, settings]) => [target, shown(settings[name], unit)] as const)
    .filter(([, value]) => value !== null);
  const values = new Set(found.map(([, value]) => value));
  if (values.size <= 1) return [...values][0] ?? null;
  return found.map(([target, value]) => `${target}: ${value}`).join(", ");
}

/**
 * All settings that are desired or reported, by target and name.
 *
 * @param units of the channels, in which thresholds are
 * @param command the last one that changed what is desired
 */
export function settingRows(state: NodeState, units: Units = new Map(), command: CommandItem | null = null): SettingRow[] {
  const rows: SettingRow[] = [];
  const targets = new Set([...Object.keys(state.desired), ...Object.keys(state.reported ?? {})]);
  for (const target of [...targets].toSorted()) {
    const desiredHere = state.desired[target] ?? {};
    const reportedHere = state.reported?.[target] ?? {};
    for (const name of [...new Set([...Object.keys(desiredHere), ...Object.keys(reportedHere)])].toSorted()) {
      const unit = unitOf(target, name, units);
      const desired = shown(desiredHere[name] ?? state.desired[WHOLE_NODE]?.[name], unit);
      const reported = target === WHOLE_NODE ? reportedOfAll(state, name) : shown(reportedHere[name], unit);
      const settled = desired === null || desired === reported;
      rows.push({ target, name, desired, reported, settled, failure: settled ? null : failureOf(command, state, { target, name }) });
    }
  }
  return rows;
}

const REFRESH_MS = 5_000;
const SOON_MS = 200;

function targetLabel(row: SettingRow): string {
  return row.target === "*" ? "whole node" : row.target;
}

function tableRow(row: SettingRow): HTMLElement {
  const attributes = { "data-testid": "setting", "data-settled": String(row.settled), "data-failed": String(row.failure !== null), class: row.settled ? null : "waits" };
  return element(
    "tr",
    attributes,
    element("th", { scope: "row" }, targetLabel(row)),
    element("td", {}, row.name),
    element("td", {}, row.desired ?? "–"),
    element("td", {}, row.reported ?? "–", row.settled ? null : element("span", { class: "mark-waits" }, row.failure ?? "not yet")),
  );
}

/** A node's desired and reported settings in a folded table; hidden until either is known. */
export class NodeSettings {
  readonly root: HTMLElement;
  private readonly body = element("tbody");
  private readonly note = element("span", { class: "settings-note", role: "status", "data-testid": "settings-note" });
  private readonly loading = new AbortController();
  private readonly units = new Map<string, string>();
  private dueAt = 0;
  private busy = false;

  constructor(
    private readonly context: Context,
    private readonly node: string,
  ) {
    const titles = ["of", "setting", "desired", "reported"].map((title) => element("th", { scope: "col" }, title));
    const table = element("table", { "aria-label": "settings" }, element("thead", {}, element("tr", {}, ...titles)), this.body);
    const head = element("summary", {}, element("h2", { class: "section-head" }, "Settings"), this.note);
    const folded = element("details", { "aria-label": "settings" }, head, element("div", { class: "settings-table" }, table));
    this.root = element("section", { class: "node-settings", "data-testid": "settings", "aria-label": `settings of ${node}`, hidden: true }, folded);
  }

  /** A command was answered: what is shown is out of date. */
  refresh(): void {
    this.dueAt = Math.min(this.dueAt, performance.now() + SOON_MS);
  }

  frame(at: number): void {
    if (this.busy || at < this.dueAt) return;
    this.dueAt = at + REFRESH_MS;
    void this.load();
  }

  destroy(): void {
    this.loading.abort();
    this.root.remove();
  }

  private async load(): Promise<void> {
    this.busy = true;
    try {
      const { client } = this.context;
      const { signal } = this.loading;
      const state = await client.state(this.node, signal);
      await this.loadUnits(state);
      const asked = state.settled || state.desired_by === null ? null : await client.command(this.node, state.desired_by, signal);
      this.show(state, asked);
    } catch (error) {
      if (!isAbort(error)) setText(this.note, `The settings could not be loaded: ${messageOf(error)}`);
    } finally {
      this.busy = false;
    }
  }

  /** Asks for the units of channels that have thresholds, once. */
  private async loadUnits(state: NodeState): Promise<void> {
    const targets = [state.desired, state.reported ?? {}].flatMap((settings) => Object.keys(settings).filter((target) => settings[target]!["threshold"] !== undefined));
    if (targets.every((target) => this.units.has(target))) return;
    for (const { id, unit } of await this.context.client.channels(this.node, this.loading.signal)) this.units.set(id, unit);
    // Of a channel that is not listed, the unit stays unknown.
    for (const target of targets) if (!this.units.has(target)) this.units.set(target, "");
  }

  private show(state: NodeState, command: CommandItem | null): void {
    const rows = settingRows(state, this.units, command);
    this.root.hidden = rows.length === 0;
    this.body.replaceChildren(...rows.map((row) => tableRow(row)));
    const reported = state.reported_at === null ? null : parseInstant(state.reported_at.lo);
    const when = reported === null ? "The node has not reported yet." : `Reported ${printDay(reported)} ${printClock(reported, 0)}.`;
    const failure = rows.find((row) => row.failure !== null)?.failure;
    const what = failure === "refused" ? "the node refused the last command" : "the last command expired";
    const why = failure ? `It is not set as desired, for ${what}: ${command?.reason ?? "it gave no reason"}.` : "It is not set as desired yet.";
    setText(this.note, `${when} ${state.settled ? "It is set as desired." : why}`);
  }
}
