/** The font and colours of a label. */
export interface Lettering {
  /** Device pixels. */
  readonly size: number;
  readonly weight: 400 | 600;
  readonly colour: string;
  /** The colour of the outline around the letters; null for none. */
  readonly halo: string | null;
}

/** A text as a picture, in device pixels. */
export interface CachedText {
  readonly image: HTMLCanvasElement;
  readonly width: number;
  readonly height: number;
}

const MOST = 400;
const ROOM = 3;
const FAMILY = "system-ui, -apple-system, 'Segoe UI', sans-serif";

/**
 * A cache of rendered labels. Drawing text on a canvas that is in the document recalculates the page's styles each
 * time; copying a picture does not.
 */
export class TextCache {
  private readonly cached = new Map<string, CachedText>();

  clear(): void {
    this.cached.clear();
  }

  get(text: string, lettering: Lettering): CachedText {
    const key = `${lettering.size} ${lettering.weight} ${lettering.colour} ${lettering.halo} ${text}`;
    const known = this.cached.get(key);
    if (known) return known;
    if (this.cached.size >= MOST) this.clear();
    const label = draw(text, lettering);
    this.cached.set(key, label);
    return label;
  }
}

function draw(text: string, { size, weight, colour, halo }: Lettering): CachedText {
  const image = document.createElement("canvas");
  const pen = image.getContext("2d");
  const font = `${weight} ${size}px ${FAMILY}`;
  if (!pen) return { image, width: 0, height: 0 };
  pen.font = font;
  image.width = Math.ceil(pen.measureText(text).width) + 2 * ROOM;
  image.height = Math.ceil(1.4 * size) + 2 * ROOM;
  // Resizing a canvas resets its context.
  pen.font = font;
  pen.textBaseline = "middle";
  if (halo !== null) {
    pen.lineWidth = 0.3 * size;
    pen.lineJoin = "round";
    pen.strokeStyle = halo;
    pen.strokeText(text, ROOM, image.height / 2);
  }
  pen.fillStyle = colour;
  pen.fillText(text, ROOM, image.height / 2);
  return { image, width: image.width - 2 * ROOM, height: image.height };
}

/** Draws a cached text with its left edge at x and its middle at y. */
export function drawText(context: CanvasRenderingContext2D, { image, height }: CachedText, x: number, y: number): void {
  if (image.width > 0) context.drawImage(image, Math.round(x) - ROOM, Math.round(y - height / 2));
}
