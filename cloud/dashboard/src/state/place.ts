import { parseInstant, printInstant, type Instant } from "../time/instant";

/** What the charts show: the newest data of a given length (ns), or a fixed stretch of time. */
export type View =
  | { readonly kind: "live"; readonly span: number }
  | { readonly kind: "history"; readonly from: Instant; readonly to: Instant };

/** A threshold question: when is the channel above (or below) a level, in the channel's unit? */
export interface Question {
  readonly side: "above" | "below";
  readonly level: number;
}

/** Where a person is in the dashboard; the address's hash says it all, so that every view can be linked to. */
export interface Place {
  readonly node: string | null;
  readonly channel: string | null;
  readonly view: View;
  readonly question: Question | null;
}

export const SPANS: readonly { readonly name: string; readonly label: string; readonly ns: number }[] = [
  { name: "5s", label: "5 s", ns: 5e9 },
  { name: "10s", label: "10 s", ns: 10e9 },
  { name: "30s", label: "30 s", ns: 30e9 },
  { name: "1m", label: "1 min", ns: 60e9 },
  { name: "5m", label: "5 min", ns: 300e9 },
];
export const DEFAULT_SPAN = 10e9;

function readView(query: URLSearchParams): View {
  const from = query.get("from");
  const to = query.get("to");
  if (from !== null && to !== null) {
    try {
      const view = { kind: "history", from: parseInstant(from), to: parseInstant(to) } as const;
      if (view.from < view.to) return view;
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
    }
  }
  const span = SPANS.find((each) => each.name === query.get("live"));
  return { kind: "live", span: span?.ns ?? DEFAULT_SPAN };
}

function readQuestion(query: URLSearchParams): Question | null {
  for (const side of ["above", "below"] as const) {
    const text = query.get(side);
    if (text !== null && text.trim() !== "" && Number.isFinite(Number(text))) return { side, level: Number(text) };
  }
  return null;
}

function decode(text: string | undefined): string | null {
  if (!text) return null;
  try {
    return decodeURIComponent(text);
  } catch {
    // A hash typed by hand may hold a lone "%"; it is then taken as it is.
    return text;
  }
}

/** Reads a hash such as `#/fingertip/t01.capacitance?live=10s`; what it cannot read falls back to live. */
export function readPlace(hash: string): Place {
  const [path = "", search = ""] = hash.replace(/^#/, "").split("?", 2);
  const [node, channel] = path.split("/").filter(Boolean);
  const query = new URLSearchParams(search);
  return { node: decode(node), channel: decode(channel), view: readView(query), question: readQuestion(query) };
}

/** Writes a place as a hash. */
export function printPlace(place: Place): string {
  const parts = [place.node, place.node === null ? null : place.channel];
  const path = parts.filter((part): part is string => part !== null).map(encodeURIComponent);
  const query: string[] = [];
  const { view, question } = place;
  if (view.kind === "history") query.push(`from=${printInstant(view.from)}`, `to=${printInstant(view.to)}`);
  else query.push(`live=${SPANS.find((span) => span.ns === view.span)?.name ?? "10s"}`);
  if (question) query.push(`${question.side}=${question.level}`);
  return `#/${path.join("/")}?${query.join("&")}`;
}
