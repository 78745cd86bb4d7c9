import type { NodeState, Setting } from "../api/contract";

/** One setting of one place, as it should be and as the node says that it is; null where nobody said. */
export interface SettingRow {
  readonly place: string;
  readonly name: string;
  readonly desired: string | null;
  readonly reported: string | null;
  readonly settled: boolean;
}

/** The place of what holds for all taxels. */
const WHOLE_NODE = "*";

function shown(value: Setting | undefined): string | null {
  return value === undefined ? null : String(value);
}

/** What a node reports of a setting that is wished of all its taxels at once. */
function reportedOfAll(state: NodeState, name: string): string | null {
  const own = state.reported?.[WHOLE_NODE]?.[name];
  if (own !== undefined) return shown(own);
  const found = Object.entries(state.reported ?? {})
    .filter(([place]) => state.desired[place]?.[name] === undefined)
    .map(([place, settings]) => [place, shown(settings[name])] as const)
    .filter(([, value]) => value !== null);
  const values = new Set(found.map(([, value]) => value));
  if (values.size <= 1) return [...values][0] ?? null;
  return found.map(([place, value]) => `${place}: ${value}`).join(", ");
}

/** All settings that are desired or reported, by place and name. */
export function settingRows(state: NodeState): SettingRow[] {
  const rows: SettingRow[] = [];
  const places = new Set([...Object.keys(state.desired), ...Object.keys(state.reported ?? {})]);
  for (const place of [...places].toSorted()) {
    const wished = state.desired[place] ?? {};
    const told = state.reported?.[place] ?? {};
    for (const name of [...new Set([...Object.keys(wished), ...Object.keys(told)])].toSorted()) {
      const desired = shown(wished[name] ?? state.desired[WHOLE_NODE]?.[name]);
      const reported = place === WHOLE_NODE ? reportedOfAll(state, name) : shown(told[name]);
      rows.push({ place, name, desired, reported, settled: desired === null || desired === reported });
    }
  }
  return rows;
}
