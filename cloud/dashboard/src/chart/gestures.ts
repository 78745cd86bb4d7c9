import { cut, pan, zoom, type Range } from "../state/window";

export interface GestureOptions {
  /** The area of the plot, and its element for the selection. */
  readonly area: HTMLElement;
  readonly range: () => Range;
  readonly onRange: (range: Range) => void;
  /** Whether the wheel zooms at once; otherwise it scrolls the page until the chart has the focus. */
  readonly wheelZooms: () => boolean;
  /** Whether a drag pans instead of selecting. */
  readonly dragPans: () => boolean;
}

const WHEEL_PACE = 0.0015;
const LEAST_DRAG = 5;

/** Zoom and pan by wheel, mouse, pen and fingers. */
export class Gestures {
  private readonly pointers = new Map<number, { x: number; start: number }>();
  private readonly selection = document.createElement("div");
  private mode: "none" | "select" | "pan" | "pinch" = "none";
  private base: Range = { x0: 0, x1: 1 };

  constructor(private readonly options: GestureOptions) {
    const { area } = options;
    this.selection.className = "selection";
    this.selection.hidden = true;
    area.append(this.selection);
    area.addEventListener("wheel", this.onWheel, { passive: false });
    area.addEventListener("pointerdown", this.onDown);
    area.addEventListener("pointermove", this.onMove);
    area.addEventListener("pointerup", this.onUp);
    area.addEventListener("pointercancel", this.onUp);
  }

  /** Whether a drag or pinch is under way. */
  get busy(): boolean {
    return this.mode !== "none";
  }

  private fraction(clientX: number): number {
    const box = this.options.area.getBoundingClientRect();
    return Math.max(0, Math.min(1, (clientX - box.left) / box.width));
  }

  private readonly onWheel = (event: WheelEvent): void => {
    if (!event.ctrlKey && !event.metaKey && !this.options.wheelZooms()) return;
    event.preventDefault();
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const sideways = Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey;
    const delta = (sideways ? event.deltaX || event.deltaY : event.deltaY) * unit;
    const range = this.options.range();
    if (sideways) this.options.onRange(pan(range, delta / this.options.area.clientWidth));
    else this.options.onRange(zoom(range, this.fraction(event.clientX), Math.exp(delta * WHEEL_PACE)));
  };

  private readonly onDown = (event: PointerEvent): void => {
    if (event.pointerType === "mouse" && event.button !== 0) return;
    this.options.area.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, start: event.clientX });
    this.base = this.options.range();
    for (const pointer of this.pointers.values()) pointer.start = pointer.x;
    if (this.pointers.size === 2) this.mode = "pinch";
    else this.mode = event.pointerType === "touch" || event.shiftKey || this.options.dragPans() ? "pan" : "select";
    this.selection.hidden = true;
  };

  private readonly onMove = (event: PointerEvent): void => {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    pointer.x = event.clientX;
    if (this.mode === "pinch") this.pinch();
    else if (Math.abs(pointer.x - pointer.start) < LEAST_DRAG && this.selection.hidden) return;
    else if (this.mode === "pan") {
      const shift = (pointer.start - pointer.x) / this.options.area.clientWidth;
      this.options.onRange(pan(this.base, shift));
    } else this.showSelection(this.fraction(pointer.start), this.fraction(pointer.x));
  };

  private readonly onUp = (event: PointerEvent): void => {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (pointer && this.mode === "select" && !this.selection.hidden && event.type === "pointerup") {
      this.options.onRange(cut(this.base, this.fraction(pointer.start), this.fraction(pointer.x)));
    }
    this.selection.hidden = true;
    this.mode = this.pointers.size === 0 ? "none" : "pan";
    this.base = this.options.range();
    for (const other of this.pointers.values()) other.start = other.x;
  };

  private pinch(): void {
    const [one, other] = [...this.pointers.values()];
    if (!one || !other) return;
    const [a0, b0] = [this.fraction(one.start), this.fraction(other.start)];
    const [a1, b1] = [this.fraction(one.x), this.fraction(other.x)];
    const before = Math.max(0.02, Math.abs(b0 - a0));
    const after = Math.max(0.02, Math.abs(b1 - a1));
    const anchor = (a0 + b0) / 2;
    const zoomed = zoom(this.base, anchor, before / after);
    this.options.onRange(pan(zoomed, anchor - (a1 + b1) / 2));
  }

  private showSelection(one: number, other: number): void {
    this.selection.hidden = false;
    this.selection.style.left = `${Math.min(one, other) * 100}%`;
    this.selection.style.width = `${Math.abs(one - other) * 100}%`;
  }
}
