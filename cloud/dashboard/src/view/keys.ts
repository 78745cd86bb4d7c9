import { DEFAULT_SPAN } from "../state/place";
import { pan, zoom, type Range } from "../state/window";
import type { Context } from "./context";

export interface KeyOptions {
  readonly context: Context;
  readonly place: { readonly node: string; readonly channel: string };
  readonly range: () => Range | null;
  /** Moves the reading cursor by entries. */
  readonly step: (by: 1 | -1) => void;
}

const FAR = 0.5;
const NEAR = 0.1;

/** Lets a focused chart be worked by keys: arrows pan, + and - zoom, comma and full stop read values. */
export function operateByKeys(root: HTMLElement, options: KeyOptions): void {
  const { showRange, go, place } = options.context;
  root.addEventListener("keydown", (event) => {
    const range = options.range();
    if (event.target !== root || event.ctrlKey || event.metaKey || event.altKey || range === null) return;
    const distance = event.shiftKey ? FAR : NEAR;
    const { view } = place();
    const actions: Record<string, () => void> = {
      ArrowLeft: () => showRange(pan(range, -distance)),
      ArrowRight: () => showRange(pan(range, distance)),
      "+": () => showRange(zoom(range, 0.5, 0.5)),
      "=": () => showRange(zoom(range, 0.5, 0.5)),
      "-": () => showRange(zoom(range, 0.5, 2)),
      ",": () => options.step(-1),
      ".": () => options.step(1),
      l: () => go({ ...place(), view: { kind: "live", span: view.kind === "live" ? view.span : DEFAULT_SPAN } }),
      Enter: () => go({ ...place(), ...options.place, question: null }),
    };
    const action = actions[event.key === "L" ? "l" : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
