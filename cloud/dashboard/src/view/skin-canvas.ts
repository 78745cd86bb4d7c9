import type { CoreItem } from "../api/contract";
import { ColourScale } from "../skin/colour-scale";
import { boundsOf, type ContactsAt, forceText } from "../skin/contacts";
import { type GestureMark, labelText, placeOfLabel, type Point } from "../skin/gestures";
import type { Skin } from "../skin/layout";
import { Painter, type SkinColours } from "../skin/painter";
import { type Raster, rasterise, taxelAt, taxelBeside, taxelsWithin } from "../skin/raster";
import type { Picture } from "../skin/stretches";
import { element, setText } from "./element";

/** A drag of fewer CSS pixels is a click. */
const LEAST_DRAG = 5;
const MOST_LABELS = 12;
/** No label is farther from the middle of its contact, in CSS pixels. */
const MOST_APART = 60;
const MOST_MARKS = 8;
/** A ring around where a gesture is, and the head of its arrow, in CSS pixels. */
const RING = 13;
const HEAD = 9;
/** A shorter way has no arrow. */
const LEAST_WAY = 10;
const SVG = "http://www.w3.org/2000/svg";
const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

export interface SkinCanvasOptions {
  readonly label: string;
  /** Taxels were clicked, or a box was drawn around them; `adds` keeps those selected before. */
  readonly onSelect: (taxels: readonly number[], adds: boolean) => void;
  /** Another taxel is pointed at, by keys or mouse; null: none. */
  readonly onPoint: (taxel: number | null) => void;
  /** Space and Escape. */
  readonly onToggle: () => void;
  readonly onEscape: () => void;
  readonly onResize: () => void;
}

type Pixel = readonly [number, number];

/** A line from one pixel to another, with a head; what is too short for one is a ring. */
function arrow(begin: Pixel | null, end: Pixel | null): string {
  const [x, y] = (end ?? begin)!;
  const length = begin === null || end === null ? 0 : Math.hypot(x - begin[0], y - begin[1]);
  if (length < LEAST_WAY) return `M${x - RING} ${y}a${RING} ${RING} 0 1 0 ${2 * RING} 0a${RING} ${RING} 0 1 0 ${-2 * RING} 0`;
  const [u, v] = [((x - begin![0]) / length) * HEAD, ((y - begin![1]) / length) * HEAD];
  return `M${begin![0]} ${begin![1]}L${x} ${y}M${x - u - v * 0.7} ${y - v + u * 0.7}L${x} ${y}L${x - u + v * 0.7} ${y - v - u * 0.7}`;
}

/** Reads the colours from the style sheet, each as `#rrggbb`. */
function readColours(pen: CanvasRenderingContext2D): SkinColours {
  const style = getComputedStyle(document.documentElement);
  const whole = (colour: string): string => {
    pen.fillStyle = colour;
    return String(pen.fillStyle);
  };
  const of = (name: string): string => whole(style.getPropertyValue(name).trim());
  return {
    values: style.getPropertyValue("--skin-values").trim().split(/\s+/).map(whole),
    ground: of("--chart-plot"),
    missing: of("--chart-missing"),
    certain: of("--chart-certain"),
    possible: of("--chart-possible"),
    rim: of("--control"),
  };
}

/** The hand itself: pixels, labels of contacts, what is selected, and gestures. */
export class SkinCanvas {
  readonly root: HTMLElement;
  private readonly canvas = element("canvas", { class: "skin-canvas", "aria-hidden": "true" });
  private readonly context: CanvasRenderingContext2D;
  private readonly outline = document.createElementNS(SVG, "path");
  private readonly labels = element("div", { class: "skin-labels", "aria-hidden": "true" });
  private readonly ways = document.createElementNS(SVG, "svg");
  private readonly names = element("div", { class: "skin-labels", "aria-hidden": "true" });
  private marked = "";
  private readonly rings = element("div", { class: "skin-rings", "aria-hidden": "true" });
  private readonly pointer = element("i", { class: "skin-ring pointed", hidden: true });
  private readonly box = element("i", { class: "skin-box", hidden: true });
  private readonly watcher: ResizeObserver;
  private skin: Skin | null = null;
  private raster: Raster | null = null;
  private painter: Painter | null = null;
  private ratio = 1;
  private pointed: number | null = null;
  private selected: readonly number[] = [];
  private drag: { readonly id: number; readonly x: number; readonly y: number; moved: boolean } | null = null;

  constructor(private readonly options: SkinCanvasOptions) {
    // The picture is made by the processor, and only copied by the browser.
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    if (context === null) throw new Error("this browser has no 2D canvas");
    this.context = context;
    const ground = document.createElementNS(SVG, "svg");
    ground.classList.add("skin-outline");
    ground.setAttribute("aria-hidden", "true");
    ground.append(this.outline);
    this.ways.classList.add("skin-ways");
    this.ways.setAttribute("aria-hidden", "true");
    const keys = "Arrows move between taxels, Enter opens the chart of one, space plays or pauses, Escape closes.";
    this.root = element(
      "div",
      { class: "skin-stage", tabindex: 0, role: "application", "aria-label": `${options.label}. ${keys}`, "data-testid": "skin-stage" },
      element("div", { class: "skin-plate" }, ground, this.canvas, this.rings, this.labels, this.ways, this.names, this.box),
    );
    this.rings.append(this.pointer);
    this.watcher = new ResizeObserver(() => this.fit());
    this.watcher.observe(this.root);
    this.root.addEventListener("keydown", this.onKey);
    this.canvas.addEventListener("pointerdown", this.onDown);
    this.canvas.addEventListener("pointermove", this.onMove);
    this.canvas.addEventListener("pointerup", this.onUp);
    this.canvas.addEventListener("pointercancel", this.onCancel);
    this.canvas.addEventListener("pointerleave", () => this.root !== document.activeElement && this.point(null));
  }

  /** Shows another skin. */
  show(skin: Skin): void {
    this.skin = skin;
    this.raster = null;
    this.pointed = null;
    this.fit();
  }

  /** Paints a picture; false where there is no room yet. */
  paint(picture: Picture, scale: ColourScale): boolean {
    if (this.painter === null || this.skin === null || picture.lo.length !== this.skin.taxels.length) return false;
    this.painter.paint(picture, this.skin.threshold, scale);
    return true;
  }

  /** How each taxel was judged in the picture painted last. */
  get verdicts(): Uint8Array {
    return this.painter?.verdicts ?? new Uint8Array();
  }

  /** Paints all taxels the next time: the scale has changed. */
  invalidate(): void {
    this.painter?.invalidate();
  }

  recolour(): void {
    this.painter?.recolour(readColours(this.context));
  }

  /** Writes the force of each contact beside it. */
  label(found: ContactsAt | null): void {
    const cores = found?.cores.slice(0, MOST_LABELS) ?? [];
    while (this.labels.children.length > cores.length) this.labels.lastElementChild!.remove();
    for (const [index, core] of cores.entries()) {
      let label = this.labels.children[index] as HTMLElement | undefined;
      if (label === undefined) {
        label = element("span", { class: "skin-label", "data-testid": "contact-label" });
        this.labels.append(label);
      }
      setText(label, forceText(core));
      const at = this.placeOf(core.centroid.map(boundsOf).map(({ lo, hi }) => (lo + hi) / 2));
      label.hidden = at === null;
      if (at === null) continue;
      // Beside the contact, not on it; within the picture.
      const wide = this.raster!.width / this.ratio;
      const flips = at[0] > 0.72 * wide;
      const apart = Math.round(this.radiusOf(core)) + 6;
      label.classList.toggle("left", flips);
      label.style.transform = `translate(${Math.round(at[0])}px, ${Math.round(at[1])}px) translate(${flips ? `calc(-100% - ${apart}px)` : `${apart}px`}, -50%)`;
    }
  }

  /**
   * Draws gestures: an arrow along the way of each touch, or a ring where it stays, and what it is, unless that would
   * hide the name of one before it.
   */
  mark(marks: readonly GestureMark[]): void {
    const shown = marks.slice(0, MOST_MARKS);
    const state = this.raster === null ? "" : JSON.stringify([shown, this.raster.width, this.ratio]);
    if (state === this.marked) return;
    this.marked = state;
    // What comes first lies on top.
    this.ways.replaceChildren(...shown.toReversed().flatMap((mark) => this.linesOf(mark)));
    this.names.replaceChildren(...shown.flatMap((mark) => this.nameOf(mark)));
    const taken: DOMRect[] = [];
    for (const name of this.names.children) {
      const box = name.getBoundingClientRect();
      const hides = taken.some((other) => box.left < other.right && other.left < box.right && box.top < other.bottom && other.top < box.bottom);
      if (hides) name.classList.add("hidden");
      else taken.push(box);
    }
  }

  /** Marks the taxels whose charts are open. */
  select(selected: readonly number[]): void {
    this.selected = selected;
    this.placeRings();
  }

  /** Moves the pointer to a taxel; null hides it. */
  point(taxel: number | null): void {
    if (taxel === this.pointed) return;
    this.pointed = taxel;
    this.placeRings();
    this.options.onPoint(taxel);
  }

  destroy(): void {
    this.watcher.disconnect();
  }

  /** A place in the map (m) in CSS pixels of the picture. */
  private placeOf([x, y]: readonly number[]): readonly [number, number] | null {
    if (this.raster === null || x === undefined || y === undefined || !Number.isFinite(x + y)) return null;
    const [column, row] = this.raster.place(x, y);
    return [column / this.ratio, row / this.ratio];
  }

  private pixelOf(point: Point | null): Pixel | null {
    return point === null ? null : this.placeOf(point);
  }

  /** A mark's lines, each with one below it that sets it off from the skin. */
  private linesOf({ ways, verdict }: GestureMark): SVGPathElement[] {
    const known = ways.map(({ begin, end }) => [this.pixelOf(begin), this.pixelOf(end)] as const);
    const drawn = known.filter(([begin, end]) => begin !== null || end !== null).map(([begin, end]) => arrow(begin, end));
    if (drawn.length === 0) return [];
    return ["under", verdict].map((look) => {
      const line = document.createElementNS(SVG, "path");
      line.setAttribute("class", look);
      line.setAttribute("d", drawn.join(""));
      return line;
    });
  }

  private nameOf(mark: GestureMark): HTMLElement[] {
    const at = this.pixelOf(placeOfLabel(mark));
    if (at === null) return [];
    const label = element("span", { class: `skin-label gesture ${mark.verdict}`, "data-testid": "gesture-label" }, labelText(mark));
    // Above the mark, not on it; within the picture.
    const share = Math.round((100 * at[0]) / (this.raster!.width / this.ratio));
    const top = at[1] < 2 * RING + 16 ? `${RING + 6}px` : `calc(-100% - ${RING + 6}px)`;
    label.style.transform = `translate(${Math.round(at[0])}px, ${Math.round(at[1])}px) translate(${-share}%, ${top})`;
    return [label];
  }

  /** How far a contact at most reaches from its middle, if it is round, in CSS pixels. */
  private radiusOf({ area }: CoreItem): number {
    const { raster, ratio } = this;
    const [x0, x1] = [raster!.place(0, 0)[0], raster!.place(1, 0)[0]];
    return Math.min(MOST_APART, (Math.sqrt((area[1] ?? area[0] ?? 0) / Math.PI) * (x1 - x0)) / ratio);
  }

  /** Fits the canvas to the room that there is. */
  private fit(): void {
    if (this.skin === null || this.root.clientWidth === 0) return;
    const ratio = devicePixelRatio;
    const style = getComputedStyle(this.root);
    const inner = this.root.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const room = { width: inner * ratio, height: parseFloat(style.getPropertyValue("--skin-height")) * 0.01 * innerHeight * ratio };
    const raster = rasterise(this.skin, room, ratio);
    if (this.raster !== null && ratio === this.ratio && raster.width === this.raster.width && raster.height === this.raster.height) return;
    this.ratio = ratio;
    this.raster = raster;
    this.canvas.width = raster.width;
    this.canvas.height = raster.height;
    const plate = this.canvas.parentElement!;
    plate.style.width = `${raster.width / ratio}px`;
    plate.style.height = `${raster.height / ratio}px`;
    this.drawOutline(this.skin);
    this.painter = new Painter(this.context, raster, ratio, readColours(this.context));
    this.placeRings();
    this.options.onResize();
  }

  /** Draws the skin's outline, under its taxels. */
  private drawOutline({ outline }: Skin): void {
    const lines = outline.map(({ x, y }) => {
      const points = x.map((each, k) => this.placeOf([each, y[k]!])!.map((at) => at.toFixed(1)).join(" "));
      return `M${points.join("L")}Z`;
    });
    this.outline.setAttribute("d", lines.join(""));
  }

  private placeRings(): void {
    const { raster, ratio, selected, pointed } = this;
    const rings = [...this.rings.querySelectorAll<HTMLElement>(".selected")];
    while (rings.length > selected.length) rings.pop()!.remove();
    while (rings.length < selected.length) {
      const ring = element("i", { class: "skin-ring selected" });
      this.rings.prepend(ring);
      rings.push(ring);
    }
    this.pointer.hidden = pointed === null;
    if (raster === null) return;
    const place = (ring: HTMLElement, taxel: number): void => {
      const size = raster.cell / ratio;
      ring.style.width = `${size}px`;
      ring.style.height = `${size}px`;
      ring.style.transform = `translate(${raster.x[taxel]! / ratio - size / 2}px, ${raster.y[taxel]! / ratio - size / 2}px)`;
    };
    for (const [index, taxel] of selected.entries()) place(rings[index]!, taxel);
    if (pointed !== null) place(this.pointer, pointed);
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.root) return;
    const direction = ARROWS[event.key];
    if (direction && this.raster) {
      const from = this.pointed ?? this.selected[0] ?? taxelAt(this.raster, this.raster.width / 2, this.raster.height / 2);
      const steps = event.shiftKey ? 10 : 1;
      let to = this.pointed === null ? Math.max(0, from) : from;
      if (this.pointed !== null) for (let step = 0; step < steps; step += 1) to = taxelBeside(this.raster, to, direction);
      this.point(to);
    } else if (event.key === "Enter" && this.pointed !== null) this.options.onSelect([this.pointed], event.shiftKey);
    else if (event.key === " ") this.options.onToggle();
    else if (event.key === "Escape") {
      this.point(null);
      this.options.onEscape();
    } else return;
    event.preventDefault();
  };

  private at(event: PointerEvent): { x: number; y: number } {
    const box = this.canvas.getBoundingClientRect();
    return { x: (event.clientX - box.left) * this.ratio, y: (event.clientY - box.top) * this.ratio };
  }

  private readonly onDown = (event: PointerEvent): void => {
    if (event.button !== 0) return;
    this.drag = { id: event.pointerId, ...this.at(event), moved: false };
    // A finger that drags scrolls the page.
    if (event.pointerType === "mouse") this.canvas.setPointerCapture(event.pointerId);
  };

  private readonly onMove = (event: PointerEvent): void => {
    const { drag, raster } = this;
    if (raster === null) return;
    const { x, y } = this.at(event);
    if (drag === null || drag.id !== event.pointerId) {
      const taxel = taxelAt(raster, x, y);
      this.point(taxel < 0 ? null : taxel);
      return;
    }
    drag.moved ||= Math.hypot(x - drag.x, y - drag.y) > LEAST_DRAG * this.ratio;
    this.box.hidden = !drag.moved;
    const [left, top] = [Math.min(x, drag.x) / this.ratio, Math.min(y, drag.y) / this.ratio];
    this.box.style.transform = `translate(${left}px, ${top}px)`;
    this.box.style.width = `${Math.abs(x - drag.x) / this.ratio}px`;
    this.box.style.height = `${Math.abs(y - drag.y) / this.ratio}px`;
  };

  private readonly onUp = (event: PointerEvent): void => {
    const { drag, raster } = this;
    this.onCancel();
    if (drag === null || raster === null) return;
    const { x, y } = this.at(event);
    const adds = event.shiftKey || event.ctrlKey || event.metaKey;
    if (drag.moved) {
      const box = { x0: Math.min(x, drag.x), x1: Math.max(x, drag.x), y0: Math.min(y, drag.y), y1: Math.max(y, drag.y) };
      this.options.onSelect(taxelsWithin(raster, box), adds);
      return;
    }
    const taxel = taxelAt(raster, x, y);
    if (taxel >= 0) this.point(taxel);
    this.options.onSelect(taxel < 0 ? [] : [taxel], adds);
  };

  private readonly onCancel = (): void => {
    this.drag = null;
    this.box.hidden = true;
  };
}
