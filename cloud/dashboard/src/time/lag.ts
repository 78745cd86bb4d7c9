import type { LagJson } from "../api/contract";
import { formatDuration } from "./duration";

/** How long after its last sample a block was stored, rounded outward: `12–15 ms`, `≤ 15 ms`, or `–`. */
export function formatLag(lag: LagJson | null): string {
  if (lag === null) return "–";
  const [least, most] = [formatDuration(lag.lo_ns, "down"), formatDuration(lag.hi_ns, "up")];
  if (lag.lo_ns <= 0) return `≤ ${most}`;
  if (least === most) return least;
  const [low = "", ...unit] = least.split(" ");
  return unit.join(" ") === most.split(" ").slice(1).join(" ") ? `${low}–${most}` : `${least} – ${most}`;
}
