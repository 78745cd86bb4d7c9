import { FrameError } from "./frame-error";

/** What frames and live messages consist of. Integers beyond 2^53 are of type bigint. */
export type Cbor = null | number | bigint | string | Uint8Array | readonly Cbor[] | ReadonlyMap<Cbor, Cbor>;

const DEEPEST = 16;
const NULL = 0xf6;
const FLOAT64 = 0xfb;
const utf8 = new TextDecoder();

/** Reads one item of CBOR (RFC 8949) of the types that frames have, with definite lengths. */
export function readCbor(data: Uint8Array): Cbor {
  const reader = new Reader(data);
  const item = reader.item(0);
  if (reader.place !== data.length) throw new FrameError(`${data.length - reader.place} bytes follow the frame`);
  return item;
}

/** Reads a CBOR sequence (RFC 8742): items one after the other. */
export function readSequence(data: Uint8Array): Cbor[] {
  const reader = new Reader(data);
  const items: Cbor[] = [];
  while (reader.place < data.length) items.push(reader.item(0));
  return items;
}

class Reader {
  place = 0;
  private readonly view: DataView;

  constructor(private readonly data: Uint8Array) {
    this.view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  }

  item(depth: number): Cbor {
    if (depth > DEEPEST) throw new FrameError(`items are nested more than ${DEEPEST} deep`);
    const first = this.view.getUint8(this.advance(1));
    const major = first >> 5;
    if (first === NULL) return null;
    if (first === FLOAT64) return this.view.getFloat64(this.advance(8));
    const count = this.count(first & 31);
    switch (major) {
      case 0:
        return count;
      case 1:
        return typeof count === "bigint" ? -1n - count : -1 - count;
      case 2:
        return this.octets(count);
      case 3:
        return utf8.decode(this.octets(count));
      case 4:
        return Array.from({ length: this.length(count) }, () => this.item(depth + 1));
      case 5:
        return new Map(Array.from({ length: this.length(count) }, () => [this.item(depth + 1), this.item(depth + 1)]));
      default:
        throw new FrameError(`an item of major type ${major} has no place in a frame`);
    }
  }

  /** Steps over bytes; gives where they begin. */
  private advance(size: number): number {
    const begin = this.place;
    if (begin + size > this.data.length) throw new FrameError(`the frame ends within the item at byte ${begin}`);
    this.place += size;
    return begin;
  }

  private count(short: number): number | bigint {
    if (short < 24) return short;
    if (short === 24) return this.view.getUint8(this.advance(1));
    if (short === 25) return this.view.getUint16(this.advance(2));
    if (short === 26) return this.view.getUint32(this.advance(4));
    if (short !== 27) throw new FrameError("a length is indefinite or reserved");
    const long = this.view.getBigUint64(this.advance(8));
    return long <= Number.MAX_SAFE_INTEGER ? Number(long) : long;
  }

  /** A length, of which there are at least as many bytes. */
  private length(count: number | bigint): number {
    if (typeof count === "bigint" || count > this.data.length - this.place) {
      throw new FrameError(`the frame ends within the item before byte ${this.place}`);
    }
    return count;
  }

  private octets(count: number | bigint): Uint8Array {
    const begin = this.advance(this.length(count));
    return this.data.subarray(begin, this.place);
  }
}
