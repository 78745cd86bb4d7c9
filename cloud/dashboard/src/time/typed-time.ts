import { type Instant, NS_PER_MS, parseInstant, printClock, printDay, printInstant } from "./instant";

/** A day, perhaps a time of day, and perhaps a zone: RFC 3339 and its shortened forms. */
const TYPED = /^(\d{4}-\d\d-\d\d)(?:[Tt ]\s*(\d\d:\d\d)(?::(\d\d)(?:[.,](\d{1,9}))?)?)?\s*([Zz]|[+-]\d\d:\d\d)?$/;

/**
 * Reads a typed time: `2026-01-31 12:00:00.5` is local, as the axes are, and one with a zone is RFC 3339;
 * what is left out at the end is 0. Null for what is no time, such as 30 February or an hour that the clocks skip.
 */
export function parseTypedInstant(text: string): Instant | null {
  const match = TYPED.exec(text.trim());
  if (!match) return null;
  const [, day = "", clock = "00:00", second = "00", fraction = "0", zone] = match;
  const written = `${day}T${clock}:${second}`;
  // Browsers take 30 February for 2 March; read as UTC, a time that there is comes back as it was written.
  const civil = Date.parse(`${written}Z`);
  if (Number.isNaN(civil) || !new Date(civil).toISOString().startsWith(written)) return null;
  if (zone !== undefined) return readZoned(`${written}.${fraction}${zone}`);
  const instant = BigInt(Date.parse(written)) * NS_PER_MS + BigInt(fraction.padEnd(9, "0"));
  return `${printDay(instant)}T${printClock(instant, 0)}` === written ? instant : null;
}

function readZoned(text: string): Instant | null {
  try {
    return parseInstant(text);
  } catch (error) {
    if (error instanceof RangeError) return null;
    throw error;
  }
}

/** Writes a time exactly, so that it is read back as it was: local, with as many decimals as it has. */
export function printTypedInstant(instant: Instant): string {
  const decimals = [0, 3, 6].find((places) => instant % 10n ** BigInt(9 - places) === 0n) ?? 9;
  const local = `${printDay(instant)} ${printClock(instant, decimals)}`;
  // Of an hour that the clocks repeat, the second one needs its zone.
  return parseTypedInstant(local) === instant ? local : printInstant(instant);
}

/** Names the zone of local times, such as `Europe/Berlin, UTC+01:00`, or `UTC`. */
export function nameZone(at: Date): string {
  const { timeZone } = new Intl.DateTimeFormat().resolvedOptions();
  if (timeZone === "UTC") return timeZone;
  const ahead = -at.getTimezoneOffset();
  const [hours, minutes] = [Math.floor(Math.abs(ahead) / 60), Math.abs(ahead) % 60].map((part) => String(part).padStart(2, "0"));
  return `${timeZone}, UTC${ahead < 0 ? "-" : "+"}${hours}:${minutes}`;
}

export interface TypedRange {
  readonly from: Instant;
  readonly to: Instant;
}

/** What is wrong with a typed range, and in which of its fields. */
export interface RefusedRange {
  readonly field: "from" | "to";
  readonly text: string;
}

const EXAMPLE = "2026-01-31 12:00:00, or with a zone 2026-01-31T12:00:00Z";

function refuse(field: "from" | "to", text: string): RefusedRange {
  if (text.trim() === "") return { field, text: `The field "${field}" is empty. Type a time such as ${EXAMPLE}.` };
  return { field, text: `"${text.trim()}" is not a time. Type one such as ${EXAMPLE}.` };
}

/** Reads a range from two fields, or returns what is wrong with it. */
export function readTypedRange(first: string, last: string): TypedRange | RefusedRange {
  const [from, to] = [parseTypedInstant(first), parseTypedInstant(last)];
  if (from === null) return refuse("from", first);
  if (to === null) return refuse("to", last);
  if (from < to) return { from, to };
  return { field: "to", text: `The end must be after the start: ${last.trim()} is not after ${first.trim()}.` };
}
