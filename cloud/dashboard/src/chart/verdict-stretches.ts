import type { Verdict, VerdictItem } from "../api/contract";
import { formatCoverage } from "../interval/format";
import type { Range } from "../state/window";
import { formatDuration } from "../time/duration";
import { decimalsFor, type Instant, parseInstant, printClock } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { leftColumn, type PlotMap, rightColumn, SLACK, xPixel } from "./plot-map";
import { readSegment, type Segment } from "./segments";
import type { TipText } from "./tooltip";

/** A stretch of time with one verdict of a formula, and why. */
export interface VerdictStretch extends Segment {
  readonly start: Instant;
  readonly end: Instant;
  readonly because: VerdictItem["because"];
  /** Whether only samples that do not exist could decide it. */
  readonly missing: boolean;
  readonly coverage: number;
}

/** What a stretch is drawn as. */
export type Look = Verdict | "missing";

/** The looks of pixel columns, by their code; 0 is a column of which nothing was answered. */
export const LOOKS = ["none", "impossible", "possible", "certain", "missing"] as const;
const [NOTHING, IMPOSSIBLE, POSSIBLE, CERTAIN, MISSING] = [0, 1, 2, 3, 4] as const;
const CODES: Readonly<Record<Look, number>> = { impossible: IMPOSSIBLE, possible: POSSIBLE, certain: CERTAIN, missing: MISSING };

const CAUSES: Readonly<Record<VerdictItem["because"][number], string>> = {
  width: "width of the interval",
  instant: "uncertain instant",
  gap: "gap",
  pending: "not known yet",
};

/** Reads stretches of the REST API, which come in order of time and leave nothing out. */
export function readStretches(items: readonly VerdictItem[], timeline: Timeline): VerdictStretch[] {
  return items.map((item) => ({
    ...readSegment(item, timeline),
    start: parseInstant(item.start),
    end: parseInstant(item.end),
    because: item.because,
    missing: item.missing,
    coverage: item.coverage,
  }));
}

export function lookOf({ verdict, missing }: Pick<VerdictStretch, "verdict" | "missing">): Look {
  return missing ? "missing" : verdict;
}

/**
 * The code of each pixel column. A column that several verdicts touch is possible, so that a certain or an impossible
 * one is so all over. One that the answer does not cover wholly is left out.
 */
export function columnCodes(map: PlotMap, stretches: readonly VerdictStretch[]): Uint8Array {
  const codes = new Uint8Array(map.width);
  const clamp = (column: number): number => Math.max(0, Math.min(map.width, column));
  for (const stretch of stretches) {
    const code = CODES[lookOf(stretch)];
    const right = clamp(rightColumn(map, stretch.x1 + stretch.error));
    for (let column = clamp(leftColumn(map, stretch.x0 - stretch.error)); column < right; column += 1) {
      codes[column] = codes[column] === NOTHING || codes[column] === code ? code : POSSIBLE;
    }
  }
  const [first, last] = [stretches[0], stretches.at(-1)];
  if (!first || !last) return codes;
  codes.fill(NOTHING, 0, clamp(Math.ceil(xPixel(map, first.x0) - SLACK)));
  codes.fill(NOTHING, clamp(Math.floor(xPixel(map, last.x1) + SLACK)));
  return codes;
}

/** Columns [left, right) with the same code. */
export interface ColumnRun {
  readonly left: number;
  readonly right: number;
  readonly code: number;
}

export function columnRuns(codes: Uint8Array): ColumnRun[] {
  const runs: ColumnRun[] = [];
  for (let left = 0; left < codes.length; ) {
    let right = left + 1;
    while (right < codes.length && codes[right] === codes[left]) right += 1;
    runs.push({ left, right, code: codes[left]! });
    left = right;
  }
  return runs;
}

/** All stretches that touch a pixel column. */
export function touching(map: PlotMap, stretches: readonly VerdictStretch[], column: number): VerdictStretch[] {
  return stretches.filter(({ x0, x1, error }) => leftColumn(map, x0 - error) <= column && column < rightColumn(map, x1 + error));
}

/** The clock at an instant, rounded to a place in one direction. */
function printInstant(instant: Instant, decimals: 0 | 3 | 6 | 9, later: boolean): string {
  const step = 10n ** BigInt(9 - decimals);
  const rest = ((instant % step) + step) % step;
  return printClock(later && rest > 0n ? instant + step - rest : instant, decimals);
}

/**
 * What is said of stretches that lie at one place, all within the answer's range.
 *
 * Instants of a certain and an impossible one are rounded so that it is so from the one to the other; else outward.
 */
export function describeStretches(found: readonly VerdictStretch[], answered: Range): TipText | null {
  const [first, last] = [found[0], found.at(-1)];
  if (!first || !last) return null;
  const looks = new Set(found.map(lookOf));
  const mixed = found.length > 1;
  const inward = !mixed && (first.verdict === "certain" || first.verdict === "impossible");
  const decimals = decimalsFor((last.x1 - first.x0) / 1000);
  const because = [...new Set(found.flatMap((stretch) => stretch.because.map((cause) => CAUSES[cause])))];
  const before = first.x0 <= answered.x0 ? " or before" : "";
  const after = last.x1 >= answered.x1 ? " or later" : "";
  const lines = [
    { name: "since", value: `${printInstant(first.start, decimals, inward)}${before}` },
    { name: "until", value: `${printInstant(last.end, decimals, !inward)}${after}` },
    ...(because.length > 0 ? [{ name: "because", value: because.join(", ") }] : []),
    { name: "coverage", value: formatCoverage(Math.min(...found.map(({ coverage }) => coverage))) },
  ];
  if (mixed) return { title: [...looks].map(nameOf).join(", "), kind: `${found.length} stretches too short to tell apart: zoom in`, lines };
  return { title: nameOf(lookOf(first)), ...(first.missing ? { kind: "only missing samples could decide it" } : {}), lines };
}

function nameOf(look: Look): string {
  return look === "missing" ? "samples missing" : look;
}

/** All verdicts of an answer in a sentence: for how long each, and how often. */
export function summarise(stretches: readonly VerdictStretch[]): string {
  const parts = (["certain", "possible", "impossible", "missing"] as const).map((look) => {
    const found = stretches.filter((stretch) => lookOf(stretch) === look);
    const length = found.reduce((sum, { x0, x1 }) => sum + x1 - x0, 0);
    const claimed = look === "certain" || look === "impossible";
    const often = `${found.length} ${found.length === 1 ? "stretch" : "stretches"}`;
    return found.length === 0 ? `nowhere ${nameOf(look)}` : `${nameOf(look)} for ${formatDuration(length, claimed ? "down" : "up")} in ${often}`;
  });
  return `Verdicts of the formula: ${parts.join("; ")}.`;
}
