import { type Instant, parseInstant, printInstant } from "../time/instant";

/** What the charts show: the newest data of a given length (ns), or a fixed stretch of time. */
export type View =
  | { readonly kind: "live"; readonly span: number }
  | { readonly kind: "history"; readonly from: Instant; readonly to: Instant };

/** A threshold question: when is the channel above (or below) a level, in the channel's unit? */
export interface ThresholdQuestion {
  readonly kind: "threshold";
  readonly side: "above" | "below";
  readonly level: number;
}

/** A model's parameter with its bounds, in its unit. */
export interface Given {
  readonly name: string;
  readonly lo: number;
  readonly hi: number;
}

/** When is the channel not what a model predicts whose time 0 is the origin? */
export interface ModelQuestion {
  readonly kind: "model";
  readonly model: string;
  readonly origin: Instant;
  readonly parameters: readonly Given[];
}

/** When does a formula over the node's channels hold? */
export interface FormulaQuestion {
  readonly kind: "formula";
  readonly formula: string;
}

/** What is asked of a channel; its answer is marked in the chart, so that there is one at a time. */
export type Question = ThresholdQuestion | ModelQuestion | FormulaQuestion;

/** What the dashboard shows. The address's hash holds all of it, so that every view can be linked to. */
export interface Route {
  readonly node: string | null;
  readonly channel: string | null;
  readonly view: View;
  readonly question: Question | null;
  /** The taxels of the node's skin whose charts are open. */
  readonly taxels?: readonly string[];
}

export const SPANS: readonly { readonly name: string; readonly label: string; readonly ns: number }[] = [
  { name: "5s", label: "5 s", ns: 5e9 },
  { name: "10s", label: "10 s", ns: 10e9 },
  { name: "30s", label: "30 s", ns: 30e9 },
  { name: "1m", label: "1 min", ns: 60e9 },
  { name: "5m", label: "5 min", ns: 300e9 },
];
export const DEFAULT_SPAN = 10e9;

function readInstant(text: string | null): Instant | null {
  try {
    return text === null ? null : parseInstant(text);
  } catch (error) {
    if (error instanceof RangeError) return null;
    throw error;
  }
}

function readView(query: URLSearchParams): View {
  const from = readInstant(query.get("from"));
  const to = readInstant(query.get("to"));
  if (from !== null && to !== null && from < to) return { kind: "history", from, to };
  const span = SPANS.find((each) => each.name === query.get("live"));
  return { kind: "live", span: span?.ns ?? DEFAULT_SPAN };
}

function readGiven(text: string): Given | null {
  const [name = "", low = "", high = low] = text.split(":");
  const [lo, hi] = [Number(low), Number(high)];
  return name !== "" && low.trim() !== "" && high.trim() !== "" && Number.isFinite(lo) && Number.isFinite(hi) ? { name, lo, hi } : null;
}

function readModelQuestion(query: URLSearchParams): ModelQuestion | null {
  const model = query.get("model");
  const origin = readInstant(query.get("origin"));
  if (!model || origin === null) return null;
  const parameters = query.getAll("parameter").map(readGiven).filter((given) => given !== null);
  return { kind: "model", model, origin, parameters };
}

function readQuestion(query: URLSearchParams): Question | null {
  const formula = query.get("formula")?.trim();
  if (formula) return { kind: "formula", formula };
  const compared = readModelQuestion(query);
  if (compared !== null) return compared;
  for (const side of ["above", "below"] as const) {
    const text = query.get(side);
    if (text !== null && text.trim() !== "" && Number.isFinite(Number(text))) return { kind: "threshold", side, level: Number(text) };
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
export function parseRoute(hash: string): Route {
  const [path = "", search = ""] = hash.replace(/^#/, "").split("?", 2);
  const [node, channel] = path.split("/").filter(Boolean);
  const query = new URLSearchParams(search);
  const taxels = query.get("taxels")?.split(",").filter(Boolean) ?? [];
  const place = { node: decode(node), channel: decode(channel), view: readView(query), question: readQuestion(query) };
  return taxels.length > 0 ? { ...place, taxels } : place;
}

/** Writes a parameter as the cloud reads it. */
export function printGiven({ name, lo, hi }: Given): string {
  return `${name}:${lo}:${hi}`;
}

function printQuestion(question: Question): string[] {
  if (question.kind === "threshold") return [`${question.side}=${encodeURIComponent(question.level)}`];
  if (question.kind === "formula") return [`formula=${encodeURIComponent(question.formula)}`];
  const { model, origin, parameters } = question;
  const given = parameters.map((one) => `parameter=${encodeURIComponent(printGiven(one))}`);
  return [`model=${encodeURIComponent(model)}`, `origin=${printInstant(origin)}`, ...given];
}

/** Writes a route as a hash. */
export function printRoute(route: Route): string {
  const parts = [route.node, route.node === null ? null : route.channel];
  const path = parts.filter((part): part is string => part !== null).map(encodeURIComponent);
  const query: string[] = [];
  const { view, question } = route;
  if (view.kind === "history") query.push(`from=${printInstant(view.from)}`, `to=${printInstant(view.to)}`);
  else query.push(`live=${SPANS.find((span) => span.ns === view.span)?.name ?? "10s"}`);
  if (question) query.push(...printQuestion(question));
  if (route.node !== null && route.channel === null && route.taxels?.length) query.push(`taxels=${route.taxels.map(encodeURIComponent).join(",")}`);
  return `#/${path.join("/")}?${query.join("&")}`;
}
