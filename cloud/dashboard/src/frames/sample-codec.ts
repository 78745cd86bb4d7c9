import { FrameError } from "./frame-error";

/** Which cells of a patch's matrix hold a sample. */
export interface Sampling {
  readonly rows: number;
  readonly columns: number;
  /** Number of the first row in the node's schedule. */
  readonly firstRow: number;
  /** For each column k: it is sampled in rows whose number is a multiple of 2^k; null: in every row. */
  readonly strides: Uint8Array | null;
}

/** Bounds, row after row; cells that hold no sample are unbounded on both sides. */
export interface Samples {
  readonly lo: Float64Array;
  readonly hi: Float64Array;
}

const GROUP = 64;
const MASK = 0xffffff;
const MOST_BITS = 24;
const MOST_STRIDE = 16;
const MOST_EXPONENT = 1022;
const PADDING = 4;
const UNKNOWN = 0;
const NO_LOWER = 1;
const NO_UPPER = 2;
const BOUNDED = 3;

/** Decodes the samples of a patch; a bound is (offset + code) * 2^exponent, exact in binary64. */
export function decodeSamples(codes: Uint8Array, sampling: Sampling, exponent: number, offset: number): Samples {
  const { cells, starts } = orderCells(sampling);
  const size = sampling.rows * sampling.columns;
  const bases = new Int32Array(size);
  const widths = new Int32Array(size);
  const data = new Uint8Array(codes.length + PADDING);
  data.set(codes);
  let place = 0;
  for (const matrix of [bases, widths]) {
    place = unpack(data, place, cells, 0, starts, matrix);
    place = unpack(data, place, cells, starts, cells.length / 2, matrix);
  }
  if (place !== codes.length) throw new FrameError(`${codes.length - place} bytes follow the last group of codes`);
  const lo = new Float64Array(size).fill(-Infinity);
  const hi = new Float64Array(size).fill(Infinity);
  const quantum = powerOfTwo(exponent);
  for (let k = 0; k < cells.length; k += 2) {
    const cell = cells[k]!;
    const before = cells[k + 1]!;
    const base = offset + bases[cell]!;
    const kind = widths[cell]!;
    if (kind === UNKNOWN) {
      if (bases[cell] !== (before < 0 ? 0 : bases[before])) throw new FrameError("an unknown sample has a difference");
    } else if (kind === NO_LOWER) {
      hi[cell] = base * quantum;
    } else {
      lo[cell] = base * quantum;
      if (kind !== NO_UPPER) hi[cell] = (base + kind - BOUNDED) * quantum;
    }
  }
  return { lo, hi };
}

interface Order {
  /** Pairs of a cell and the cell that predicts it, or -1. */
  readonly cells: Int32Array;
  /** How many of them are first samples of columns; all others follow. */
  readonly starts: number;
}

/** Matrices without strides have few shapes, and a frame has many patches of one: listing cells takes as long as decoding. */
const orders = new Map<number, Order>();
const MOST_ORDERS = 64;

function orderCells(sampling: Sampling): Order {
  const { rows, columns, strides } = sampling;
  if (strides) return listCells(sampling);
  const shape = rows * 2 ** 16 + columns;
  let order = orders.get(shape);
  if (order === undefined) {
    if (orders.size >= MOST_ORDERS) orders.clear();
    order = listCells(sampling);
    orders.set(shape, order);
  }
  return order;
}

function listCells({ rows, columns, firstRow, strides }: Sampling): Order {
  const first: number[] = [];
  const later: number[] = [];
  const last = new Int32Array(columns).fill(-1);
  const phase = firstRow % 2 ** MOST_STRIDE; // the number itself and a row may be more than 2^53
  let previous = -1;
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      if (strides && (phase + row) % 2 ** strides[column]! !== 0) continue;
      const cell = row * columns + column;
      if (last[column]! < 0) {
        first.push(cell, previous);
        previous = cell;
      } else {
        later.push(cell, last[column]!);
      }
      last[column] = cell;
    }
  }
  return { cells: Int32Array.from([...first, ...later]), starts: first.length / 2 };
}

/** Reads groups of differences into codes; gives where they end. */
function unpack(data: Uint8Array, from: number, cells: Int32Array, begin: number, end: number, codes: Int32Array): number {
  let place = from;
  for (let group = begin; group < end; group += GROUP) {
    const count = Math.min(end - group, GROUP);
    const width = data[place]!;
    const bytes = (count * width + 7) >> 3;
    if (width > MOST_BITS || place + 1 + bytes > data.length - PADDING) {
      throw new FrameError(`codes end within the group at byte ${place}, or its codes have more than ${MOST_BITS} bits`);
    }
    place += 1;
    const mask = (1 << width) - 1;
    for (let k = 0; k < count; k += 1) {
      const bit = k * width;
      const at = place + (bit >> 3);
      const word = data[at]! | (data[at + 1]! << 8) | (data[at + 2]! << 16) | (data[at + 3]! << 24);
      const folded = (word >>> (bit & 7)) & mask;
      const before = cells[2 * (group + k) + 1]!;
      const step = (folded >>> 1) ^ -(folded & 1);
      codes[cells[2 * (group + k)]!] = (step + (before < 0 ? 0 : codes[before]!)) & MASK;
    }
    place += bytes;
  }
  return place;
}

/** 2^exponent, exactly, for exponents of normal numbers; engines may round `**`. */
function powerOfTwo(exponent: number): number {
  if (Math.abs(exponent) > MOST_EXPONENT) throw new FrameError(`exponent ${exponent} is that of no quantum`);
  return new Float64Array(BigUint64Array.of(BigInt(exponent + 1023) << 52n).buffer)[0]!;
}
