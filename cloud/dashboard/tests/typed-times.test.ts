import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { parseInstant } from "../src/time/instant";
import { nameZone, parseTypedInstant, printTypedInstant, readTypedRange } from "../src/time/typed-time";

beforeEach(() => {
  vi.stubEnv("TZ", "Europe/Berlin");
});
afterEach(() => {
  vi.unstubAllEnvs();
});

describe("typed times", () => {
  test("without a zone they are local, in summer and in winter", () => {
    expect(parseTypedInstant("2026-01-31 12:00:00")).toBe(parseInstant("2026-01-31T11:00:00Z"));
    expect(parseTypedInstant("2026-07-31T12:00:00.25")).toBe(parseInstant("2026-07-31T10:00:00.25Z"));
  });

  test("with a zone they are RFC 3339", () => {
    expect(parseTypedInstant("2026-01-31T12:00:00.123456789Z")).toBe(parseInstant("2026-01-31T12:00:00.123456789Z"));
    expect(parseTypedInstant(" 2026-01-31 12:00:00 -05:00 ")).toBe(parseInstant("2026-01-31T17:00:00Z"));
  });

  test("what is left out at the end is 0", () => {
    const day = parseInstant("2026-01-30T23:00:00Z");
    expect(["2026-01-31", "2026-01-31 00:00", "2026-01-31 00:00:00"].map(parseTypedInstant)).toEqual([day, day, day]);
  });

  test("what no calendar and no clock has is no time", () => {
    const none = [
      "", "now", "31.1.2026", "2026-01-31 12", "2026-1-31 12:00", "2026-02-30 12:00:00", "2026-13-01", "2026-01-31 24:00:00", "2026-01-31 12:60",
      "2026-02-30T12:00:00Z", "2026-01-31T12:00:00+99:00", "2026-01-31 12:00:00.1234567891",
      // The clocks skip this hour.
      "2026-03-29 02:30:00",
    ];
    expect(none.filter((text) => parseTypedInstant(text) !== null)).toEqual([]);
  });

  test("what is printed is read back to the nanosecond, also in an hour that the clocks repeat", () => {
    const texts = [
      "2026-01-31T11:00:00Z", "2026-01-31T11:00:00.5Z", "2026-01-31T11:00:00.000001Z", "2026-01-31T11:00:00.000000001Z",
      "2026-10-25T00:30:00Z", "2026-10-25T01:30:00Z", "1969-12-31T23:59:59.999999999Z",
    ];
    for (const instant of texts.map(parseInstant)) expect(parseTypedInstant(printTypedInstant(instant))).toBe(instant);
    expect(printTypedInstant(parseInstant("2026-01-31T11:00:00.5Z"))).toBe("2026-01-31 12:00:00.500");
  });

  test("the zone is named with how far it is ahead", () => {
    expect(nameZone(new Date("2026-01-31T12:00:00Z"))).toBe("Europe/Berlin, UTC+01:00");
    expect(nameZone(new Date("2026-07-31T12:00:00Z"))).toBe("Europe/Berlin, UTC+02:00");
    vi.stubEnv("TZ", "America/St_Johns");
    expect(nameZone(new Date("2026-01-31T12:00:00Z"))).toBe("America/St_Johns, UTC-03:30");
    vi.stubEnv("TZ", "UTC");
    expect(nameZone(new Date("2026-01-31T12:00:00Z"))).toBe("UTC");
  });
});

describe("a typed range", () => {
  test("is read from two times", () => {
    const range = { from: parseInstant("2026-01-31T11:00:00Z"), to: parseInstant("2026-01-31T11:00:01Z") };
    expect(readTypedRange("2026-01-31 12:00:00", "2026-01-31T11:00:01Z")).toEqual(range);
  });

  test("that is reversed or has no length says so", () => {
    for (const first of ["2026-02-01 12:00:00", "2026-01-31 12:00:00"]) {
      const read = readTypedRange(first, "2026-01-31 12:00:00");
      expect(read).toEqual({ field: "to", text: `The end must be after the start: 2026-01-31 12:00:00 is not after ${first}.` });
    }
  });

  test("that cannot be read says which field, and gives an example", () => {
    expect(readTypedRange("yesterday", "")).toMatchObject({ field: "from", text: expect.stringMatching(/^"yesterday" is not a time.*2026-01-31 12:00:00/) });
    expect(readTypedRange("2026-01-31", " ")).toMatchObject({ field: "to", text: expect.stringMatching(/^The field "to" is empty.*2026-01-31 12:00:00/) });
  });
});
