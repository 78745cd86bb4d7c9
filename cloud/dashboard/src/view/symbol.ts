import type { Health, Verdict } from "../api/contract";
import { icon } from "./element";

/** A node's health as far as it is known: not at all while the cloud cannot be reached. */
export type KnownHealth = Health | "unknown";

const HEALTH: Readonly<Record<KnownHealth, { path: string; filled: boolean }>> = {
  online: { path: "M8 3a5 5 0 1 0 0 10a5 5 0 1 0 0-10z", filled: true },
  late: { path: "M8 2.5 L14 13 H2 Z M8 6.5 V9.5 M8 11 V11.4", filled: false },
  offline: { path: "M8 3a5 5 0 1 0 0 10a5 5 0 1 0 0-10z M4.6 11.4 L11.4 4.6", filled: false },
  unknown: { path: "M6 6.2 A2.1 2.1 0 1 1 8 8.6 V9.8 M8 12 V12.4", filled: false },
};

/** A disc, a warning triangle, a crossed ring, or a question mark: health without relying on colour. */
export function healthSymbol(health: KnownHealth): SVGSVGElement {
  const { path, filled } = HEALTH[health] ?? HEALTH.offline;
  const symbol = icon(path, filled);
  symbol.classList.add("health", health);
  return symbol;
}

/** The triangle that marks a peak: filled when certain, hollow and dashed when possible. */
export function verdictSymbol(verdict: Verdict): SVGSVGElement {
  const symbol = icon("M2.5 4 H13.5 L8 13 Z", verdict === "certain");
  symbol.classList.add("verdict", verdict);
  return symbol;
}

const LAMPS = { on: "M8 3a5 5 0 1 0 0 10a5 5 0 1 0 0-10z", off: "M8 3a5 5 0 1 0 0 10a5 5 0 1 0 0-10z", unknown: HEALTH.unknown.path } as const;

/** A lamp: a full disc that shines, an empty one, or a question mark. */
export function lampSymbol(level: keyof typeof LAMPS): SVGSVGElement {
  const symbol = icon(LAMPS[level], level === "on");
  symbol.classList.add("lamp", level);
  return symbol;
}

export const ICONS = {
  gap: "M2 4 V12 M14 4 V12 M5 8 H6 M10 8 H11",
  status: "M2 8 H5 L7 4 L9 12 L11 8 H14",
  command: "M2 4 H9 M13 4 H14 M11 2 V6 M2 12 H3 M7 12 H14 M5 10 V14 M2 8 H14",
  moon: "M13 9.5 A5.5 5.5 0 1 1 6.5 3 A4.5 4.5 0 0 0 13 9.5 Z",
  sun: "M8 5.2a2.8 2.8 0 1 0 0 5.6a2.8 2.8 0 1 0 0-5.6z M8 1.5V3 M8 13v1.5 M1.5 8H3 M13 8h1.5 M3.4 3.4l1 1 M11.6 11.6l1 1 M3.4 12.6l1-1 M11.6 4.4l1-1",
  logout: "M6 3 H3 V13 H6 M7 8 H14 M11 5 L14 8 L11 11",
  left: "M10 3 L5 8 L10 13",
  right: "M6 3 L11 8 L6 13",
  plus: "M8 3 V13 M3 8 H13",
  minus: "M3 8 H13",
  open: "M6 3 H3 V13 H13 V10 M9 3 H13 V7 M13 3 L7.5 8.5",
} as const;
