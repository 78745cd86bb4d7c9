/** How values map to the device pixels of a plot area, whose top left pixel is (0, 0). */
export interface PlotMap {
  readonly width: number;
  readonly height: number;
  readonly xMin: number;
  readonly xMax: number;
  readonly yMin: number;
  readonly yMax: number;
}

/** Shields floor and ceil from the last bits of the arithmetic; it only ever widens. */
export const SLACK = 1e-6;

export function xPixel(map: PlotMap, x: number): number {
  return ((x - map.xMin) / (map.xMax - map.xMin)) * map.width;
}

export function yPixel(map: PlotMap, y: number): number {
  return ((map.yMax - y) / (map.yMax - map.yMin)) * map.height;
}

function clamp(value: number, least: number, most: number): number {
  return Math.max(least, Math.min(most, value));
}

/** The upper edge of a painted value: its pixel row rounded up on the screen, so that it is enclosed. */
export function topRow(map: PlotMap, hi: number): number {
  return clamp(Math.floor(yPixel(map, hi) - SLACK), 0, map.height);
}

/** The lower edge (exclusive) of a painted value, rounded down on the screen. */
export function bottomRow(map: PlotMap, lo: number): number {
  return clamp(Math.ceil(yPixel(map, lo) + SLACK), 0, map.height);
}

/** The first pixel column that x touches. */
export function leftColumn(map: PlotMap, x: number): number {
  return Math.floor(xPixel(map, x) - SLACK);
}

/** The column after the last one that x touches. */
export function rightColumn(map: PlotMap, x: number): number {
  return Math.ceil(xPixel(map, x) + SLACK);
}

/** A rectangle in whole device pixels. */
export interface PixelBox {
  readonly left: number;
  readonly top: number;
  readonly right: number;
  readonly bottom: number;
}

/** The smallest box of whole pixels, at least `least` wide and high, around a region of the plot. */
export function enclosingBox(
  map: PlotMap,
  region: { x0: number; x1: number; lo: number; hi: number },
  least: number,
): PixelBox {
  const left = leftColumn(map, region.x0);
  const right = rightColumn(map, region.x1);
  const top = topRow(map, region.hi);
  const bottom = bottomRow(map, region.lo);
  const wider = Math.max(0, Math.ceil((least - (right - left)) / 2));
  const higher = Math.max(0, Math.ceil((least - (bottom - top)) / 2));
  return { left: left - wider, right: right + wider, top: top - higher, bottom: bottom + higher };
}
