import type { Instant } from "../time/instant";
import { parseTypedInstant } from "../time/typed-instant";

export interface TypedRange {
  readonly from: Instant;
  readonly to: Instant;
}

/** What is wrong with a typed range, and in which of its fields. */
export interface RangeComplaint {
  readonly field: "from" | "to";
  readonly text: string;
}

const EXAMPLE = "2026-01-31 12:00:00, or with a zone 2026-01-31T12:00:00Z";

function complain(field: "from" | "to", text: string): RangeComplaint {
  if (text.trim() === "") return { field, text: `The field "${field}" is empty. Type a time such as ${EXAMPLE}.` };
  return { field, text: `"${text.trim()}" is not a time. Type one such as ${EXAMPLE}.` };
}

/** Reads a stretch of time from two fields, or says what people need to know to mend it. */
export function readTypedRange(first: string, last: string): TypedRange | RangeComplaint {
  const [from, to] = [parseTypedInstant(first), parseTypedInstant(last)];
  if (from === null) return complain("from", first);
  if (to === null) return complain("to", last);
  if (from < to) return { from, to };
  return { field: "to", text: `The end must be after the start: ${last.trim()} is not after ${first.trim()}.` };
}
