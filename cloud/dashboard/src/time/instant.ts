/** Instants are whole nanoseconds since 1970-01-01T00:00:00Z; bigint keeps them exact. */
export type Instant = bigint;

const RFC_3339 = /^(\d{4}-\d\d-\d\d)[Tt](\d\d:\d\d:\d\d)(?:\.(\d{1,}))?([Zz]|[+-]\d\d:\d\d)$/;
export const NS_PER_MS = 1_000_000n;
export const NS_PER_SECOND = 1_000_000_000n;

/** Reads an RFC 3339 time (any number of decimals; beyond nanoseconds they are cut). */
export function parseInstant(text: string): Instant {
  const match = RFC_3339.exec(text);
  const whole = match ? Date.parse(`${match[1]}T${match[2]}${match[4]?.toUpperCase()}`) : Number.NaN;
  if (!match || Number.isNaN(whole)) {
    throw new RangeError(`not a time: "${text}"; give RFC 3339, such as 2026-01-31T12:00:00.5Z`);
  }
  const fraction = (match[3] ?? "").padEnd(9, "0").slice(0, 9);
  return BigInt(whole) * NS_PER_MS + BigInt(fraction);
}

function floorSplit(instant: Instant): { seconds: bigint; rest: bigint } {
  const rest = ((instant % NS_PER_SECOND) + NS_PER_SECOND) % NS_PER_SECOND;
  return { seconds: (instant - rest) / NS_PER_SECOND, rest };
}

/** Writes an instant as RFC 3339 in UTC with nine decimals. */
export function printInstant(instant: Instant): string {
  const { seconds, rest } = floorSplit(instant);
  const whole = new Date(Number(seconds) * 1000).toISOString().slice(0, 19);
  return `${whole}.${rest.toString().padStart(9, "0")}Z`;
}

function two(value: number): string {
  return value.toString().padStart(2, "0");
}

/** Writes the local time of day, cut (not rounded) to the given number of decimals. */
export function printClock(instant: Instant, decimals: number): string {
  const { seconds, rest } = floorSplit(instant);
  const date = new Date(Number(seconds) * 1000);
  const clock = `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
  return decimals === 0 ? clock : `${clock}.${rest.toString().padStart(9, "0").slice(0, decimals)}`;
}

/** Writes the local calendar day as YYYY-MM-DD. */
export function printDay(instant: Instant): string {
  const date = new Date(Number(floorSplit(instant).seconds) * 1000);
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

/** The decimals that distinguish two instants `span` ns apart (0, 3, 6 or 9). */
export function decimalsFor(span: number): 0 | 3 | 6 | 9 {
  if (span >= 2e9) return 0;
  if (span >= 1e6) return 3;
  return span >= 1e3 ? 6 : 9;
}
