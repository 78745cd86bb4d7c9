import { readCbor, readSequence, type Cbor } from "./cbor";
import { FrameError } from "./frame-error";
import { decodeSamples, type Samples, type Sampling } from "./sample-codec";

/** When a patch is sampled; times in ns. */
export interface Grid {
  readonly delay: number;
  readonly period: number;
  readonly firstRow: number;
  readonly rows: number;
  readonly coverage: number;
}

/** Decoded samples of one patch. */
export interface PatchSamples {
  /** Its number in the layout. */
  readonly patch: number;
  readonly grid: Grid;
  readonly epoch: number;
  readonly sampling: Sampling;
  readonly samples: Samples;
}

/** What a node measured on one page of its skin in one stretch of time. */
export interface Frame {
  readonly boot: number;
  readonly sequence: number;
  /** Hash of the layout by which it is read. */
  readonly layout: Uint8Array;
  readonly page: number;
  /** The node's clock at the first instant, ns since its start. */
  readonly ticks: bigint;
  /** Enclosure of the same instant, UTC ns. */
  readonly time: readonly [bigint, bigint];
  readonly patches: readonly PatchSamples[];
}

const KIND = 1;
const STRIDES = 1;
const MOST_CELLS = 2 ** 18;

/** Reads a frame (docs/messages.md). It is trusted to be canonical: gateway and cloud have checked that. */
export function readFrame(data: Uint8Array): Frame {
  return frameOf(readCbor(data));
}

/** Reads frames that follow one another, as `application/cbor-seq` has them. */
export function readFrames(data: Uint8Array): Frame[] {
  return readSequence(data).map(frameOf);
}

function frameOf(fields: Cbor): Frame {
  if (!(fields instanceof Map) || fields.get(1) !== KIND) throw new FrameError("these bytes are no frame");
  const grids = list(fields.get(8)).map((grid): Grid => {
    const [delay, period, firstRow, rows, coverage] = list(grid);
    if (typeof coverage !== "number") throw new FrameError("a grid has no coverage");
    return { delay: count(delay), period: count(period), firstRow: count(firstRow), rows: count(rows), coverage };
  });
  const [earliest, latest] = list(fields.get(7));
  let room = MOST_CELLS;
  const patches = list(fields.get(9)).map((samples) => {
    const patch = readPatch(list(samples), grids, room);
    room -= patch.sampling.rows * patch.sampling.columns;
    return patch;
  });
  return {
    boot: count(fields.get(2)),
    sequence: count(fields.get(3)),
    layout: octets(fields.get(4)),
    page: count(fields.get(5)),
    ticks: BigInt(integer(fields.get(6))),
    time: [BigInt(integer(earliest)), BigInt(integer(latest))],
    patches,
  };
}

/** @param room so many cells it may have */
function readPatch(values: readonly Cbor[], grids: readonly Grid[], room: number): PatchSamples {
  const [patch, gridNumber, epoch, columns] = values.slice(0, 4).map(count);
  const grid = grids[gridNumber!];
  if (grid === undefined) throw new FrameError(`patch ${patch} has grid ${gridNumber}; there are ${grids.length}`);
  if (!(columns! * grid.rows <= room)) throw new FrameError(`the frame has more than ${MOST_CELLS} cells, from patch ${patch} on`);
  const options = values[7];
  const strides = options instanceof Map ? options.get(STRIDES) : undefined;
  const sampling: Sampling = {
    rows: grid.rows,
    columns: columns!,
    firstRow: grid.firstRow,
    strides: strides === undefined ? null : octets(strides),
  };
  const samples = decodeSamples(octets(values[6]), sampling, Number(integer(values[4])), Number(integer(values[5])));
  return { patch: patch!, grid, epoch: epoch!, sampling, samples };
}

function list(value: Cbor | undefined): readonly Cbor[] {
  if (!Array.isArray(value)) throw new FrameError(`${String(value)} is no array`);
  return value as readonly Cbor[];
}

function integer(value: Cbor | undefined): number | bigint {
  if (typeof value === "bigint" || (typeof value === "number" && Number.isInteger(value))) return value;
  throw new FrameError(`${String(value)} is no integer`);
}

function count(value: Cbor | undefined): number {
  const found = integer(value);
  if (typeof found === "number" && found >= 0) return found;
  throw new FrameError(`${found} is no count up to 2^53 - 1`);
}

function octets(value: Cbor | undefined): Uint8Array {
  if (!(value instanceof Uint8Array)) throw new FrameError(`${String(value)} is no byte string`);
  return value;
}
