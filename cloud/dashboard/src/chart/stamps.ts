/** How a text is written. */
export interface Lettering {
  /** Device pixels. */
  readonly size: number;
  readonly weight: 400 | 600;
  readonly colour: string;
  /** What surrounds the letters, over other paint; null for nothing. */
  readonly halo: string | null;
}

/** A text as a picture, in device pixels. */
export interface Stamp {
  readonly image: HTMLCanvasElement;
  readonly width: number;
  readonly height: number;
}

const MOST = 400;
const ROOM = 3;
const FAMILY = "system-ui, -apple-system, 'Segoe UI', sans-serif";

/**
 * Texts of the charts, written once and then copied: to write on a canvas that is on the page has the page's styles
 * worked out first, each time.
 */
export class Stamps {
  private readonly made = new Map<string, Stamp>();

  clear(): void {
    this.made.clear();
  }

  stamp(text: string, lettering: Lettering): Stamp {
    const key = `${lettering.size} ${lettering.weight} ${lettering.colour} ${lettering.halo} ${text}`;
    const known = this.made.get(key);
    if (known) return known;
    if (this.made.size >= MOST) this.clear();
    const made = write(text, lettering);
    this.made.set(key, made);
    return made;
  }
}

function write(text: string, { size, weight, colour, halo }: Lettering): Stamp {
  const image = document.createElement("canvas");
  const pen = image.getContext("2d");
  const font = `${weight} ${size}px ${FAMILY}`;
  if (!pen) return { image, width: 0, height: 0 };
  pen.font = font;
  image.width = Math.ceil(pen.measureText(text).width) + 2 * ROOM;
  image.height = Math.ceil(1.4 * size) + 2 * ROOM;
  // A canvas that changes its size forgets how to write.
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

/** Copies a stamp so that its letters begin at x, and its middle lies at y. */
export function place(context: CanvasRenderingContext2D, { image, height }: Stamp, x: number, y: number): void {
  if (image.width > 0) context.drawImage(image, Math.round(x) - ROOM, Math.round(y - height / 2));
}
