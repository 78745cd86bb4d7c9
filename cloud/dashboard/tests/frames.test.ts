import { describe, expect, test } from "vitest";
import { FrameError } from "../src/frames/frame-error";
import { readFrame } from "../src/frames/frame";
import vectors from "./frames.json";

function bytes(hex: string): Uint8Array {
  return Uint8Array.from(hex.match(/../g) ?? [], (pair) => parseInt(pair, 16));
}

function floats(hex: string): Float64Array {
  return new Float64Array(bytes(hex).buffer);
}

function inHex(byte: number): string {
  return byte.toString(16).padStart(2, "0");
}

/** A frame of patches of 1000 rows and 64 columns, of which the first row alone is sampled; all is unknown. */
function sparse(patches: number): Uint8Array {
  const strides = `a1015840${"10".repeat(64)}`;
  const items = Array.from({ length: patches }, (_, number) => `88${inHex(number)}000018400000420000${strides}`);
  const head = `a9010102010302045820${"00".repeat(32)}0500060007820001`;
  const grids = "088185001903e8001903e8fb3ff0000000000000";
  return bytes(`${head}${grids}09${inHex(0x80 + patches)}${items.join("")}`);
}

describe("frames that Python wrote", () => {
  test.each(vectors)("vector %$ has the same bounds, bit by bit", ({ frame, patches }) => {
    const read = readFrame(bytes(frame));
    expect(read.patches.length).toBe(patches.length);
    read.patches.forEach(({ samples }, k) => {
      expect(samples.lo).toEqual(floats(patches[k]!.lo));
      expect(samples.hi).toEqual(floats(patches[k]!.hi));
    });
  });

  test("the head says when and by which layout", () => {
    const frame = readFrame(bytes(vectors[0]!.frame));
    expect([frame.boot, frame.sequence, frame.page, frame.ticks]).toEqual([3, 17, 0, 3_000_000_000n]);
    expect(frame.time).toEqual([1_790_000_003_000_000_000n, 1_790_000_003_000_004_000n]);
    expect(frame.layout.length).toBe(32);
    expect(frame.patches.map(({ patch, epoch }) => [patch, epoch])).toEqual([[0, 2], [1, 0]]);
    expect(frame.patches[1]!.grid).toEqual({ delay: 8e6, period: 2e7, firstRow: 150, rows: 1, coverage: 0.999 });
  });

  test("a node may run for years", () => {
    const ticks = 400n * 86_400n * 1_000_000_000n + 1n;
    const head = vectors[0]!.frame.replace("061ab2d05e00", `061b${ticks.toString(16).padStart(16, "0")}`);
    expect(readFrame(bytes(head)).ticks).toBe(ticks);
  });

  test("frames that were cut are refused", () => {
    const whole = bytes(vectors[0]!.frame);
    for (let size = 0; size < whole.length; size += 1) {
      expect(() => readFrame(whole.subarray(0, size))).toThrow(FrameError);
    }
    expect(() => readFrame(Uint8Array.from([...whole, 0]))).toThrow(FrameError);
  });

  test("a few bytes become no more cells than the format allows", () => {
    expect(readFrame(sparse(4)).patches.length).toBe(4);
    expect(() => readFrame(sparse(5))).toThrow(FrameError);
  });

  test("a changed byte is refused or read; nothing else is thrown", () => {
    const whole = bytes(vectors[0]!.frame);
    for (let place = 0; place < whole.length; place += 1) {
      for (const value of [0, 0x18, 0x7f, 0xff, whole[place]! ^ 1]) {
        const changed = whole.slice();
        changed[place] = value;
        try {
          readFrame(changed);
        } catch (error) {
          expect(error).toBeInstanceOf(FrameError);
        }
      }
    }
  });
});
