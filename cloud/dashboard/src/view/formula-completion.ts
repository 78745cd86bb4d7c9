import type { ChannelItem } from "../api/contract";
import { findUnit } from "../interval/unit";

/** One thing that may be written next. */
export interface Choice {
  /** How it is shown, and found. */
  readonly label: string;
  /** What it is: an operator, a channel, a unit. */
  readonly kind: string;
  /** What is written instead of the word that was begun. */
  readonly text: string;
}

/** What may be written at the caret. */
export interface Offer {
  /** Where the word begins that was begun, and which a choice replaces; it ends at the caret. */
  readonly from: number;
  readonly word: string;
  readonly choices: readonly Choice[];
}

type Known = Pick<ChannelItem, "id" | "unit">;

/** What may begin a formula or a value: with a window, with an argument, or alone. */
const WINDOWED = ["always", "eventually", "historically", "once"];
const CALLED = ["rise", "fall", "count", "delay", "abs", "min", "max"];
const BETWEEN = ["and", "or", "implies"];
const BETWEEN_WINDOWED = ["until", "since"];
const TIMES = ["ms", "s", "us", "min", "ns", "h", "d"];
const PREFIXES = ["", "m", "u", "n", "p", "k", "M"];
const PLAIN = /^[A-Za-z_]\w*(?:\.\w+)*$/;
const MOST_CHOICES = 12;

const OPERATORS: readonly Choice[] = [
  ...WINDOWED.map((label) => ({ label, kind: "operator", text: `${label}[0,` })),
  ...CALLED.map((label) => ({ label, kind: "operator", text: `${label}(` })),
  { label: "not", kind: "operator", text: "not " },
];
const CONNECTIVES: readonly Choice[] = [
  ...BETWEEN.map((label) => ({ label, kind: "operator", text: `${label} ` })),
  ...BETWEEN_WINDOWED.map((label) => ({ label, kind: "operator", text: `${label}[0,` })),
];
const WORDS = new Set([...WINDOWED, ...CALLED, ...BETWEEN, ...BETWEEN_WINDOWED, "not"]);

function channelChoice({ id, unit }: Known): Choice {
  const { symbol } = findUnit(unit);
  const plain = PLAIN.test(id) && !WORDS.has(id);
  return { label: id, kind: symbol === "" ? "channel" : `channel, ${symbol}`, text: plain ? id : `"${id}"` };
}

/** Units that a number beside a channel may have, as UCUM writes them. */
function unitChoices(code: string): Choice[] {
  const { power } = findUnit(code);
  const codes = power > 0 && !code.includes("/") ? PREFIXES.map((prefix) => `${prefix}${code}`) : [code];
  return codes.map((text) => ({ label: text, kind: "unit", text }));
}

/** Those that begin with a word, and then the channels that contain it. */
function matching(choices: readonly Choice[], word: string): Choice[] {
  const sought = word.toLowerCase();
  const begins = ({ label }: Choice): boolean => label.toLowerCase().startsWith(sought);
  const contains = ({ label }: Choice): boolean => label.toLowerCase().includes(sought);
  return [...choices.filter(begins), ...choices.filter((choice) => choice.kind !== "operator" && !begins(choice) && contains(choice))].slice(0, MOST_CHOICES);
}

function offer(choices: readonly Choice[], from: number, word: string): Offer {
  return { from, word, choices: matching(choices, word) };
}

/** The channel that is named last, if its unit is known. */
function lastChannel(text: string, channels: readonly Known[]): Known | undefined {
  const names = [...text.matchAll(/"([^"]*)"|[A-Za-z_]\w*(?:\.\w+)*/g)].map(([whole, quoted]) => quoted ?? whole);
  return names.map((name) => channels.find(({ id }) => id === name)).findLast(Boolean);
}

/** What may be written at a caret of a text, as far as it can be said without the grammar. */
export function offerAt(text: string, caret: number, channels: readonly Known[]): Offer {
  const before = text.slice(0, caret);
  const quoted = /^[^"]*(?:"[^"]*"[^"]*)*"([^"]*)$/.exec(before)?.[1];
  if (quoted !== undefined) {
    const from = caret - quoted.length - 1;
    return offer(channels.map((channel) => ({ ...channelChoice(channel), text: `"${channel.id}"` })), from, quoted);
  }
  const number = /(?:^|[^\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(\s*)([A-Za-z%]*)$/.exec(before);
  if (number) {
    const [, blanks = "", word = ""] = number;
    const inWindow = before.lastIndexOf("[") > before.lastIndexOf("]");
    const units = inWindow ? TIMES.map((unit) => ({ label: unit, kind: "unit", text: unit })) : unitChoices(lastChannel(before, channels)?.unit ?? "1");
    const found = units.filter(({ label }) => label !== "1" && label.startsWith(word));
    const more = blanks === "" || word === "" ? [] : matching(CONNECTIVES, word);
    return { from: caret - word.length, word, choices: [...found, ...more] };
  }
  const word = /[A-Za-z_][\w.]*$/.exec(before)?.[0] ?? "";
  const from = caret - word.length;
  const rest = before.slice(0, from).trimEnd();
  const last = /[A-Za-z_][\w.]*$/.exec(rest)?.[0] ?? "";
  const expectsOperand = rest === "" || /[([,<>=+\-*/\]]$/.test(rest) || WORDS.has(last);
  if (rest.endsWith("[") || rest.lastIndexOf("[") > rest.lastIndexOf("]")) return { from, word, choices: [] };
  return offer(expectsOperand ? [...channels.map(channelChoice), ...OPERATORS] : CONNECTIVES, from, word);
}

/** Whether what was begun is there already: nothing is left to complete. */
export function isComplete({ word, choices }: Offer): boolean {
  return word !== "" && choices.some(({ label }) => label === word);
}

/** A text with a choice in the place of the word that was begun, and where the caret then is. */
export function complete(text: string, caret: number, { from }: Offer, choice: Choice): { text: string; caret: number } {
  const rest = text.slice(caret);
  const last = choice.text.at(-1)!;
  // What follows may have the bracket, the quote or the blank already.
  const open = choice.text.indexOf("[");
  const doubled = rest.startsWith(last) && /[(" ]/.test(last);
  const written = open > 0 && rest.startsWith("[") ? choice.text.slice(0, open) : doubled ? choice.text.slice(0, -1) : choice.text;
  const ends = from + written.length + (doubled ? 1 : 0);
  return { text: text.slice(0, from) + written + rest, caret: ends };
}
