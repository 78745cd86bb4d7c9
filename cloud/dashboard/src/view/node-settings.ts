import type { NodeState } from "../api/contract";
import { isAbort, messageOf } from "../api/failure";
import { settingRows, type SettingRow } from "../state/settings";
import { parseInstant, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { element, setText } from "./element";

const REFRESH_MS = 5_000;
const SOON_MS = 200;

function place(row: SettingRow): string {
  return row.place === "*" ? "whole node" : row.place;
}

function tableRow(row: SettingRow): HTMLElement {
  const attributes = { "data-testid": "setting", "data-settled": String(row.settled), class: row.settled ? null : "waits" };
  return element(
    "tr",
    attributes,
    element("th", { scope: "row" }, place(row)),
    element("td", {}, row.name),
    element("td", {}, row.desired ?? "–"),
    element("td", {}, row.reported ?? "–", row.settled ? null : element("span", { class: "mark-waits" }, "not yet")),
  );
}

/** How a node should be set, and beside it how it says that it is, folded away; nothing until either is known. */
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
    const told = state.reported_at === null ? null : parseInstant(state.reported_at.lo);
    const when = told === null ? "The node has not reported yet." : `Reported ${printDay(told)} ${printClock(told, 0)}.`;
    setText(this.note, state.settled ? `${when} It is set as desired.` : `${when} It is not set as desired yet.`);
  }
}
