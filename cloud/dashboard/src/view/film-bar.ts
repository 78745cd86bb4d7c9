import { boundsOf, type ContactsAt } from "../skin/contacts";
import { formatInterval } from "../interval/format";
import { type Range, zoom, pan, cut } from "../state/window";
import { decimalsFor, printClock, printDay } from "../time/instant";
import type { Context } from "./context";
import { button, element, icon, setText } from "./element";

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 60, 600];
const PLAY = "M5 3 L13 8 L5 13 Z";
const PAUSE = "M5 3 V13 M11 3 V13";
const HEIGHT = 56;
const WHEEL_PACE = 0.0015;
/** The strip is as high as this many times the greatest force that is certain, at most. */
const MOST_TIMES = 3;
/** One press of an arrow key moves by this share of the window. */
const KEY_STEP = 0.01;

export interface FilmBarOptions {
  readonly context: Context;
  readonly range: () => Range | null;
  readonly onToggle: () => void;
  readonly onLive: () => void;
  /** The user moves the position. */
  readonly onScrub: (x: number) => void;
}

/** The time line below a skin: how hard it was pressed over time, the position, and what plays it. */
export class FilmBar {
  readonly root: HTMLElement;
  private readonly play = button("", { class: "tool", "data-testid": "film-play" }, () => this.options.onToggle());
  private readonly live = button("Live", { "data-testid": "film-live", title: "Follow the newest data" }, () => this.options.onLive());
  private readonly choice = element("select", { "aria-label": "speed", "data-testid": "film-speed" });
  private readonly canvas = element("canvas", { class: "film-canvas", "aria-hidden": "true" });
  private readonly cursor = element("i", { class: "film-cursor", hidden: true });
  private readonly strip: HTMLElement;
  private readonly clock = element("span", { class: "film-clock", "data-testid": "film-clock" });
  private readonly most = element("span", { class: "film-most", "aria-hidden": "true" });
  private playing: boolean | null = null;
  private isLive: boolean | null = null;
  private scrubbing = false;
  private position: number | null = null;

  constructor(private readonly options: FilmBarOptions) {
    for (const speed of SPEEDS) this.choice.append(element("option", { value: speed }, `${speed}×`));
    this.choice.value = "1";
    this.strip = element(
      "div",
      { class: "film-strip", tabindex: 0, role: "slider", "aria-label": "time", "aria-valuemin": 0, "aria-valuemax": 100, "data-testid": "film-strip" },
      this.canvas,
      this.cursor,
      this.most,
    );
    const controls = element("div", { class: "film-controls" }, element("span", { class: "group" }, this.play, this.choice), this.live, this.clock);
    this.root = element("div", { class: "film", role: "group", "aria-label": "film" }, controls, this.strip);
    this.strip.addEventListener("pointerdown", this.onDown);
    this.strip.addEventListener("pointermove", this.onMove);
    this.strip.addEventListener("pointerup", this.onUp);
    this.strip.addEventListener("pointercancel", this.onUp);
    this.strip.addEventListener("wheel", this.onWheel, { passive: false });
    this.strip.addEventListener("keydown", this.onKey);
    this.showPlaying(true, true);
  }

  /** How many times faster than the skin's own time the film runs. */
  get speed(): number {
    return Number(this.choice.value);
  }

  /** Whether the user is moving the position just now. */
  get held(): boolean {
    return this.scrubbing;
  }

  showPlaying(playing: boolean, live: boolean): void {
    if (live !== this.isLive) {
      this.isLive = live;
      this.live.setAttribute("aria-pressed", String(live));
      this.choice.disabled = live;
    }
    if (playing === this.playing) return;
    this.playing = playing;
    const label = playing ? "pause" : "play";
    this.play.replaceChildren(icon(playing ? PAUSE : PLAY, !playing));
    this.play.setAttribute("aria-label", label);
    this.play.title = `${label} (space)`;
  }

  /** Moves the position's mark; texts are written only now and then. */
  showPosition(x: number | null, range: Range | null, texts: boolean): void {
    this.position = x;
    this.cursor.hidden = x === null || range === null;
    if (x === null || range === null) {
      if (texts) setText(this.clock, "–");
      return;
    }
    const share = Math.max(0, Math.min(1, (x - range.x0) / (range.x1 - range.x0)));
    // Live, it stays next to the end of the window.
    if (texts || !this.isLive) this.cursor.style.transform = `translateX(${100 * share}%)`;
    if (!texts) return;
    const instant = this.options.context.timeline.toInstant(x);
    const text = `${printDay(instant)} ${printClock(instant, Math.min(3, Math.max(1, decimalsFor((range.x1 - range.x0) / 1000))))}`;
    setText(this.clock, text);
    this.strip.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    this.strip.setAttribute("aria-valuetext", text);
  }

  /**
   * Paints the sum of all forces over a window: a band from what is certain to what is possible.
   *
   * @param stated whether contacts are stated at all
   */
  paint(track: readonly ContactsAt[], range: Range | null, stated: boolean): void {
    const ratio = devicePixelRatio;
    const [width, height] = [Math.round(this.strip.clientWidth * ratio), Math.round(HEIGHT * ratio)];
    if (width === 0) return;
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const pen = this.canvas.getContext("2d");
    if (pen === null) return;
    pen.clearRect(0, 0, width, height);
    if (range === null) return;
    const shown = track.filter(({ x }) => x >= range.x0 - (range.x1 - range.x0) && x <= range.x1);
    const sums = shown.map(({ cores }) => cores.map(({ force }) => boundsOf(force)).reduce((sum, { lo, hi }) => ({ lo: sum.lo + lo, hi: sum.hi + hi }), { lo: 0, hi: 0 }));
    const most = Math.max(1e-9, ...sums.map(({ lo, hi }) => (Number.isFinite(hi) ? hi : lo)));
    const least = Math.max(0, ...sums.map(({ lo }) => lo));
    // An instant of which little is known must not flatten all others: it is cut off.
    const top = least > 0 ? Math.min(most, MOST_TIMES * least) : most;
    const { palette } = this.options.context;
    const toY = (force: number): number => height - Math.min(1, force / top) * (height - 14 * ratio) - 1;
    const step = typicalStep(shown);
    for (const [index, { x }] of shown.entries()) {
      const until = Math.min(shown[index + 1]?.x ?? x + step, x + 2 * step);
      const left = Math.floor(((x - range.x0) / (range.x1 - range.x0)) * width);
      const right = Math.max(left + 1, Math.floor(((until - range.x0) / (range.x1 - range.x0)) * width));
      const { lo, hi } = sums[index]!;
      if (hi <= 0) continue;
      const bounded = hi <= top;
      const [low, high] = [Math.ceil(toY(lo)), bounded ? Math.floor(toY(hi)) : 0];
      pen.fillStyle = palette.colour("certain-fill");
      pen.fillRect(left, low, right - left, height - low);
      pen.fillStyle = palette.hatch(pen, "certain", Math.round(6 * ratio));
      pen.fillRect(left, high, right - left, low - high);
      pen.fillStyle = palette.colour("certain");
      pen.fillRect(left, low, right - left, ratio);
      if (bounded) pen.fillRect(left, high, right - left, ratio);
    }
    setText(this.most, sums.some(({ hi }) => hi > 0) ? `sum of forces ${formatInterval({ lo: -Infinity, hi: most }, "N")}` : stated ? "no contact in this window" : "");
  }

  private instantAt(clientX: number): number | null {
    const range = this.options.range();
    const box = this.strip.getBoundingClientRect();
    if (range === null || box.width === 0) return null;
    const share = Math.max(0, Math.min(1, (clientX - box.left) / box.width));
    return range.x0 + share * (range.x1 - range.x0);
  }

  private readonly onDown = (event: PointerEvent): void => {
    if (event.button !== 0) return;
    this.strip.setPointerCapture(event.pointerId);
    this.scrubbing = true;
    this.scrub(event.clientX);
  };

  private readonly onMove = (event: PointerEvent): void => {
    if (this.scrubbing) this.scrub(event.clientX);
  };

  private readonly onUp = (): void => {
    this.scrubbing = false;
  };

  private scrub(clientX: number): void {
    const x = this.instantAt(clientX);
    if (x !== null) this.options.onScrub(x);
  }

  private readonly onWheel = (event: WheelEvent): void => {
    const range = this.options.range();
    if (range === null) return;
    event.preventDefault();
    const box = this.strip.getBoundingClientRect();
    const anchor = Math.max(0, Math.min(1, (event.clientX - box.left) / box.width));
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const sideways = Math.abs(event.deltaX) > Math.abs(event.deltaY);
    const { showRange } = this.options.context;
    if (sideways) showRange(pan(range, (event.deltaX * unit) / box.width));
    else showRange(zoom(range, anchor, Math.exp(event.deltaY * unit * WHEEL_PACE)));
  };

  private readonly onKey = (event: KeyboardEvent): void => {
    const range = this.options.range();
    if (range === null || event.ctrlKey || event.metaKey || event.altKey) return;
    const { showRange } = this.options.context;
    const step = (event.shiftKey ? 10 : 1) * KEY_STEP * (range.x1 - range.x0);
    const actions: Readonly<Record<string, () => void>> = {
      ArrowLeft: () => this.options.onScrub((this.position ?? range.x1) - step),
      ArrowRight: () => this.options.onScrub((this.position ?? range.x0) + step),
      Home: () => this.options.onScrub(range.x0),
      End: () => this.options.onScrub(range.x1),
      " ": () => this.options.onToggle(),
      "+": () => showRange(cut(range, 0.25, 0.75)),
      "-": () => showRange(zoom(range, 0.5, 2)),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  };
}

/** The usual time from one statement to the next: the median. */
function typicalStep(track: readonly ContactsAt[]): number {
  const steps = track.slice(1).map(({ x }, index) => x - track[index]!.x).toSorted((one, other) => one - other);
  return steps[steps.length >> 1] ?? 1e8;
}
