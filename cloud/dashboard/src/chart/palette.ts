import { element } from "../view/element";
import { TextCache } from "./text-cache";

const NAMES = [
  "axis", "grid", "band", "band-edge", "certain", "certain-fill", "possible", "missing", "text", "plot",
  "segment-certain", "segment-possible", "threshold", "predicted", "predicted-edge",
] as const;

export type Colour = (typeof NAMES)[number];

/** The chart's colours, read from the style sheet so that light and dark live in one place. */
export class Palette {
  private colours = new Map<Colour, string>();
  private readonly hatches = new Map<string, CanvasPattern>();
  private readonly pixels = new Map<Colour, number>();
  /** Texts in these colours. */
  readonly texts = new TextCache();

  constructor(private readonly root: HTMLElement) {
    this.refresh();
  }

  /** Reads the colours again after a change of theme. */
  refresh(): void {
    const style = getComputedStyle(this.root);
    this.colours = new Map(NAMES.map((name) => [name, style.getPropertyValue(`--chart-${name}`).trim()]));
    this.hatches.clear();
    this.pixels.clear();
    this.texts.clear();
  }

  colour(name: Colour): string {
    return this.colours.get(name) ?? "";
  }

  /** A colour as a pixel of image data, in this machine's order of bytes. */
  pixel(name: Colour): number {
    const known = this.pixels.get(name);
    if (known !== undefined) return known;
    const pen = element("canvas", { width: 1, height: 1 }).getContext("2d");
    if (!pen) return 0;
    pen.fillStyle = this.colour(name);
    pen.fillRect(0, 0, 1, 1);
    const pixel = new Uint32Array(pen.getImageData(0, 0, 1, 1).data.buffer)[0]!;
    this.pixels.set(name, pixel);
    return pixel;
  }

  /** A diagonal hatch, which distinguishes "possible" and "missing" from a solid fill without colour. */
  hatch(context: CanvasRenderingContext2D, name: Colour, pitch: number): CanvasPattern | string {
    const key = `${name} ${pitch}`;
    const known = this.hatches.get(key);
    if (known) return known;
    const tile = document.createElement("canvas");
    tile.width = pitch;
    tile.height = pitch;
    const pen = tile.getContext("2d");
    if (!pen) return this.colour(name);
    pen.strokeStyle = this.colour(name);
    pen.lineWidth = Math.max(1, pitch / 6);
    pen.beginPath();
    for (const shift of [-pitch, 0, pitch]) {
      pen.moveTo(shift - 1, pitch + 1);
      pen.lineTo(shift + pitch + 1, -1);
    }
    pen.stroke();
    const pattern = context.createPattern(tile, "repeat");
    if (pattern) this.hatches.set(key, pattern);
    return pattern ?? this.colour(name);
  }
}
