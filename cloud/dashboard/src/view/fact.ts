import { formatDuration } from "../time/duration";
import { parseInstant, printClock, printDay } from "../time/instant";
import { element } from "./element";

/**
 * A name and its value, for a list of facts.
 *
 * @param minor whether it is left out where there is little room: what is as usual
 */
export function fact(name: string, value: HTMLElement | string, minor = false): HTMLElement[] {
  const attributes = minor ? { class: "minor" } : {};
  return [element("dt", attributes, name), element("dd", attributes, value)];
}

/** A time, and how long ago it was. */
export function seenAgo(time: string, now: bigint): string {
  const seen = parseInstant(time);
  const ago = Number(now - seen);
  const clock = now - seen > 86_400_000_000_000n ? `${printDay(seen)} ${printClock(seen, 0)}` : printClock(seen, 0);
  // By the page's clock, which may be behind the cloud's: then the age is unknown.
  if (ago < -2e9) return clock;
  return ago < 2e9 ? `${clock}, now` : `${clock}, ${formatDuration(Math.floor(ago / 1e9) * 1e9)} ago`;
}

/** From this share on a store of messages counts as filling, and is always shown. */
const FILLING_PERCENT = 40;

function percentOf({ bytes, capacity_bytes }: { bytes: number; capacity_bytes: number }): number {
  return Math.ceil((capacity_bytes > 0 ? Math.min(1, bytes / capacity_bytes) : 0) * 100);
}

/** Whether a store of messages has the room that it usually has. */
export function hasRoom(fill: { bytes: number; capacity_bytes: number }): boolean {
  return percentOf(fill) < FILLING_PERCENT;
}

/** How full a store of messages is, as a bar and in words. */
export function fillMeter(label: string, fill: { messages: number; bytes: number; capacity_bytes: number }): HTMLElement {
  const percent = percentOf(fill);
  const bar = element("span", { class: "meter-fill" });
  bar.style.width = `${percent}%`;
  const level = percent >= 80 ? "high" : percent >= FILLING_PERCENT ? "middle" : "low";
  return element(
    "span",
    { class: "meter-line" },
    element("span", { class: "meter", "data-level": level, role: "meter", "aria-label": label, "aria-valuenow": percent, "aria-valuemin": 0, "aria-valuemax": 100 }, bar),
    element("span", {}, `${percent} % · ${fill.messages.toLocaleString("en")} msg`),
  );
}

/** Prints bytes with a binary prefix, rounded up. */
export function formatBytes(bytes: number): string {
  const names = ["B", "KiB", "MiB", "GiB", "TiB"];
  let scale = 0;
  while (scale < names.length - 1 && bytes >= 1024 ** (scale + 1)) scale += 1;
  const value = bytes / 1024 ** scale;
  const text = scale === 0 || value >= 100 ? Math.ceil(value) : Math.ceil(value * 10) / 10;
  return `${text} ${names[scale]}`;
}
