import { DEFAULT_SPAN } from "../state/route";
import { pan, type Range, zoom } from "../state/window";
import type { Context } from "./context";

export interface ShortcutOptions {
  readonly context: Context;
  readonly target: { readonly node: string; readonly channel: string };
  readonly range: () => Range | null;
  /** Moves the reading cursor by entries. */
  readonly step: (by: 1 | -1) => void;
}

const FAR = 0.5;
const NEAR = 0.1;

/** Lets a focused chart be worked by keys: arrows pan, + and - zoom, comma and full stop read values. */
export function addShortcuts(root: HTMLElement, options: ShortcutOptions): void {
  const { showRange, go, route } = options.context;
  root.addEventListener("keydown", (event) => {
    const range = options.range();
    if (event.target !== root || event.ctrlKey || event.metaKey || event.altKey || range === null) return;
    const distance = event.shiftKey ? FAR : NEAR;
    const { view } = route();
    const actions: Record<string, () => void> = {
      ArrowLeft: () => showRange(pan(range, -distance)),
      ArrowRight: () => showRange(pan(range, distance)),
      "+": () => showRange(zoom(range, 0.5, 0.5)),
      "=": () => showRange(zoom(range, 0.5, 0.5)),
      "-": () => showRange(zoom(range, 0.5, 2)),
      ",": () => options.step(-1),
      ".": () => options.step(1),
      l: () => go({ ...route(), view: { kind: "live", span: view.kind === "live" ? view.span : DEFAULT_SPAN } }),
      Enter: () => go({ ...route(), ...options.target, question: null }),
    };
    const action = actions[event.key === "L" ? "l" : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
