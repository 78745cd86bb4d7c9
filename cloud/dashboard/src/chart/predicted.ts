import type { PredictionAnswer } from "../api/contract";
import { parseInstant } from "../time/instant";
import type { Timeline } from "../time/timeline";
import { type Entries, HULL_REACH } from "../tube/entries";
import { type Canvas, type Columns, paintFill } from "./band";

/** Reads a predicted tube: each entry encloses all that is predicted over its width; null is unbounded. */
export function readPrediction(answer: Pick<PredictionAnswer, "t0" | "t" | "lo" | "hi" | "dt">, timeline: Timeline): Entries {
  const start = timeline.toX(parseInstant(answer.t0));
  return {
    t: Float64Array.from(answer.t, (offset) => start + offset),
    width: new Float64Array(answer.t.length).fill(answer.dt),
    lo: Float64Array.from(answer.lo, (bound) => bound ?? -Infinity),
    hi: Float64Array.from(answer.hi, (bound) => bound ?? Infinity),
    doubt: new Float64Array(answer.t.length),
    error: new Float64Array(answer.t.length),
    reach: new Float64Array(answer.t.length).fill(HULL_REACH * answer.dt),
  };
}

/** Follows one edge of a hull in steps, half a line's width inside of it; what leaves the plot has no edge. */
function edgePath(rows: Int32Array, columns: Columns, within: { from: number; to: number; inset: number }): Path2D {
  const path = new Path2D();
  let drawing = false;
  for (let i = 0; i < rows.length; i += 1) {
    const row = rows[i]!;
    const present = columns.bottom[i]! > columns.top[i]! && row > within.from && row < within.to;
    if (present) {
      if (!drawing) path.moveTo(i, row + within.inset);
      path.lineTo(i, row + within.inset);
      path.lineTo(i + 1, row + within.inset);
    }
    drawing = present;
  }
  return path;
}

/** Paints what is predicted as a pale hull in dashes, which distinguish it from the measured band without colour. */
export function paintPredicted(canvas: Canvas, columns: Columns, height: number): void {
  const { context, palette, ratio } = canvas;
  const line = 1.5 * ratio;
  context.fillStyle = palette.colour("predicted");
  paintFill(context, columns);
  context.strokeStyle = palette.colour("predicted-edge");
  context.lineWidth = line;
  context.setLineDash([6 * ratio, 4 * ratio]);
  context.stroke(edgePath(columns.top, columns, { from: 0, to: height, inset: line / 2 }));
  context.stroke(edgePath(columns.bottom, columns, { from: 0, to: height, inset: -line / 2 }));
  context.setLineDash([]);
}
