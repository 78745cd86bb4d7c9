import type { NodeState, Setting } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
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
}

/** The target of what holds for all taxels. */
const WHOLE_NODE = "*";

function shown(value: Setting | undefined): string | null {
  return value === undefined ? null : String(value);
}

/** What a node reports of a setting that is desired for all its taxels. */
function reportedOfAll(state: NodeState, name: string): string | null {
  const own = state.reported?.[WHOLE_NODE]?.[name];
  if (own !== undefined) return shown(own);
  const found = Object.entries(state.reported ?? {})
    .filter(([target]) => state.desired[target]?.[name] === undefined)
    .map(([target, settings]) => [target, shown(settings[name])] as const)
    .filter(([, value]) => value !== null);
  const values = new Set(found.map(([, value]) => value));
  if (values.size <= 1) return [...values][0] ?? null;
  return found.map(([target, value]) => `${target}: ${value}`).join(", ");
}

/** All settings that are desired or reported, by target and name. */
export function settingRows(state: NodeState): SettingRow[] {
  const rows: SettingRow[] = [];
  const targets = new Set([...Object.keys(state.desired), ...Object.keys(state.reported ?? {})]);
  for (const target of [...targets].toSorted()) {
    const desiredHere = state.desired[target] ?? {};
    const reportedHere = state.reported?.[target] ?? {};
    for (const name of [...new Set([...Object.keys(desiredHere), ...Object.keys(reportedHere)])].toSorted()) {
      const desired = shown(desiredHere[name] ?? state.desired[WHOLE_NODE]?.[name]);
      const reported = target === WHOLE_NODE ? reportedOfAll(state, name) : shown(reportedHere[name]);
      rows.push({ target, name, desired, reported, settled: desired === null || desired === reported });
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
  const attributes = { "data-testid": "setting", "data-settled": String(row.settled), class: row.settled ? null : "waits" };
  return element(
    "tr",
    attributes,
    element("th", { scope: "row" }, targetLabel(row)),
    element("td", {}, row.name),
    element("td", {}, row.desired ?? "–"),
    element("td", {}, row.reported ?? "–", row.settled ? null : element("span", { class: "mark-waits" }, "not yet")),
  );
}

/** A node's desired and reported settings in a folded table; hidden until either is known. */
export class NodeSettings {
  readonly root: HTMLElement;
  private readonly body = element("tbody");
  private readonly note = element("span", { class: "settings-note", role: "status", "data-testid": "settings-note" });
  private readonly loading = new AbortController();
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
      this.show(await this.context.client.state(this.node, this.loading.signal));
    } catch (error) {
      if (!isAbort(error)) setText(this.note, `The settings could not be loaded: ${messageOf(error)}`);
    } finally {
      this.busy = false;
    }
  }

  private show(state: NodeState): void {
    const rows = settingRows(state);
    this.root.hidden = rows.length === 0;
    this.body.replaceChildren(...rows.map((row) => tableRow(row)));
    const reported = state.reported_at === null ? null : parseInstant(state.reported_at.lo);
    const when = reported === null ? "The node has not reported yet." : `Reported ${printDay(reported)} ${printClock(reported, 0)}.`;
    setText(this.note, state.settled ? `${when} It is set as desired.` : `${when} It is not set as desired yet.`);
  }
}
