import type { LayoutItem } from "../api/contract";
import { isAbort, messageOf } from "../api/error";
import { formatCount, formatInterval, formatTicks } from "../interval/format";
import { ColourScale } from "../skin/colour-scale";
import { boundsOf, ContactTrack, contactsAt, type ContactsAt, describeContacts, forceText, totalOf } from "../skin/contacts";
import { Film, PICTURES, type Wanted } from "../skin/film";
import { askedOf } from "../skin/gestures";
import { quantitiesIn, type Skin, skinOf } from "../skin/layout";
import type { NodeFrames } from "../skin/node-frames";
import { CERTAIN, POSSIBLE, UNKNOWN } from "../skin/painter";
import { Playback } from "../skin/playback";
import { emptyPicture, type Picture } from "../skin/stretches";
import { DEFAULT_SPAN, type View } from "../state/route";
import { pan, type Range } from "../state/window";
import { formatDuration } from "../time/duration";
import { Throttle, TEXT_MS } from "../time/throttle";
import type { Context } from "./context";
import { element, setText } from "./element";
import { FilmBar } from "./film-bar";
import { LevelField } from "./level-field";
import { NoticeBoard } from "./notice";
import { PictureReport } from "./picture-report";
import { SkinCanvas } from "./skin-canvas";
import { SkinGestures } from "./skin-gestures";

/** When no frame came for so long, or for four stretches, nothing is known of the present. */
const STALE_MS = 1_000;
const STALE_STRETCHES = 4;
/** A statement of contacts holds for so long, in ns, if its stretch is shorter. */
const LEAST_REACH = 2e8;
const SETTLE_MS = 250;
/** Contacts that a window of the past is drawn with: each is computed anew by the cloud. */
const CONTACT_POINTS = 20;
const MOST_CONTACTS = 2_000;
/** A film that is no farther behind the newest data (ns) goes on live. */
const LEAST_LEFT = 1e9;
/** A film shows about so many pictures a second. */
const FILM_RATE = 30;
/** What screen readers are given changes this often at most, in ms. */
const SPOKEN_MS = 3_000;
/** A skin of no more taxels than this takes less room. */
const FEW = 40;
/** Light touches of a fingertip begin about here: from where on a pressure counts where the layout does not say. */
const TOUCH_PA = 1_000;
const LISTED = 6;
/** How long it is said that frames were left out, in ms. */
const SKIPPED_MS = 10_000;
/** A film that plays faster shows no gestures. */
const GESTURE_SPEED = 2;
/** Data that comes later than this is not the present. */
const LATE_NS = 1e9;

export interface SkinViewOptions {
  readonly context: Context;
  readonly node: string;
  readonly frames: NodeFrames;
  /** Whether gestures are asked for: they cost the cloud time. */
  readonly gestures: boolean;
  /** Taxels were chosen by hand. */
  readonly onSelect: (taxels: readonly string[], adds: boolean) => void;
  /** All charts are to be closed. */
  readonly onEscape: () => void;
  /** Another quantity is shown. */
  readonly onQuantity: () => void;
}

/** What is said of frames that were not shown; null: some, and their number is not known. */
function leftOut(frames: number | null): string {
  if (frames === null) return "Frames were left out: this page was disconnected for too long.";
  return `${frames.toLocaleString("en")} frames were left out: the connection or this browser is too slow.`;
}

/** A node's skin as it is touched, now or in the past. */
export class SkinView {
  readonly root: HTMLElement;
  private readonly canvas: SkinCanvas;
  private readonly gestures: SkinGestures | null;
  private readonly film: FilmBar;
  private readonly choice = element("select", { "aria-label": "quantity", "data-testid": "skin-quantity" });
  private readonly total = element("strong", { class: "skin-total", "data-testid": "skin-total" });
  private readonly list = element("ol", { class: "skin-contacts", "data-testid": "skin-contacts" });
  private readonly taxel = element("p", { class: "skin-taxel", "data-testid": "skin-taxel" });
  private readonly counts = element("p", { class: "skin-counts", "data-testid": "skin-summary" });
  private readonly warning = element("p", { class: "skin-warning", "data-testid": "skin-warning" });
  /** From where on a taxel counts as pressed, where the layout does not say. */
  private readonly level = new LevelField(() => this.useLevel());
  private readonly leveled = element("label", { class: "skin-level" }, "Mark what is above", this.level.root);
  private readonly ends = [element("span"), element("span"), element("span")] as const;
  private readonly bar = element("div", { class: "scale-bar" });
  private readonly mark = element("i", { class: "scale-mark" });
  private readonly spoken = element("div", { class: "unseen", role: "status", "aria-live": "polite", "data-testid": "skin-spoken" });
  private readonly overlay = element("div", { class: "skin-overlay" });
  private readonly notices = new NoticeBoard(this.overlay);
  private readonly playback = new Playback();
  private readonly reels: Film;
  /** Contacts of the past that were asked for. */
  private readonly past = new ContactTrack(MOST_CONTACTS);
  private readonly report = new PictureReport();
  private readonly texts = new Throttle(TEXT_MS);
  private readonly speech = new Throttle(SPOKEN_MS);
  private skin: Skin | null = null;
  /** Whether the layout says from where on a taxel is pressed: only then the cloud states contacts. */
  private stated = false;
  private picture: Picture | null = null;
  private scale = new ColourScale(null);
  private view: View;
  /** The position in the past, in ns of the timeline. */
  private position: number | null = null;
  private playing = false;
  private movedAt = 0;
  private drawn = "";
  private drawnStrip = "";
  private pictures = 0;
  private pointed: number | null = null;
  private selected: readonly number[] = [];
  private shownContacts: ContactsAt | null = null;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private loading = new AbortController();
  private failure = "";
  /** At which position contacts were asked for, and since when (ms) it has stood still. */
  private asked: number | null = null;
  private rest = { position: Number.NaN, since: 0 };
  /** Null: some, and their number is not known. */
  private skipped: number | null = 0;
  private skippedAt = -Infinity;
  private visible = true;
  /** Whether pictures of the past are on their way: until they are there, nothing is said to be unknown. */
  private awaits = false;

  constructor(private readonly options: SkinViewOptions) {
    const { context, node } = options;
    this.view = context.route().view;
    this.gestures = options.gestures ? new SkinGestures(context, node, () => this.redraw()) : null;
    this.reels = new Film({
      timeline: context.timeline,
      ask: (range, points, signal) => this.askFilm(range, points, signal),
      onLoaded: () => this.loaded(),
      onFailure: (error) => this.fail(error),
      now: () => performance.now(),
      present: () => this.options.frames.stretches.end ?? context.timeline.now(),
    });
    this.canvas = new SkinCanvas({
      label: `Skin of ${node}`,
      onSelect: (taxels, adds) => this.choose(taxels, adds),
      onPoint: (taxel) => this.point(taxel),
      onToggle: () => this.toggle(),
      onEscape: options.onEscape,
      onResize: () => this.redraw(),
    });
    this.film = new FilmBar({
      context,
      range: () => this.range(),
      onToggle: () => this.toggle(),
      onLive: () => context.go({ ...context.route(), view: { kind: "live", span: DEFAULT_SPAN } }),
      onScrub: (x) => this.scrub(x),
    });
    this.choice.addEventListener("change", () => {
      this.useQuantity();
      options.onQuantity();
    });
    this.root = this.build();
    if (this.view.kind === "history") this.enterPast();
  }

  /** The list of the latest gestures, to be put below the picture; null where none are asked for. */
  get gestureList(): HTMLElement | null {
    return this.gestures?.root ?? null;
  }

  /** Shows the taxels of a layout. */
  useLayout(layout: LayoutItem): void {
    const quantities = quantitiesIn(layout);
    const before = this.choice.value;
    this.choice.replaceChildren(...quantities.map((name) => element("option", { value: name }, name.replaceAll("_", " "))));
    this.choice.hidden = quantities.length < 2;
    if (quantities.includes(before)) this.choice.value = before;
    this.reels.clear();
    if (quantities.length > 0) this.useQuantity();
  }

  /** Shows another window: the newest data, or the past. */
  apply(view: View): void {
    const before = this.view;
    this.view = view;
    if (view.kind === "live") {
      if (before.kind === "history") this.playback.stop();
      this.playing = false;
      this.position = null;
      this.failure = "";
    } else this.enterPast();
  }

  /** Marks taxels by their names. */
  select(names: readonly string[]): void {
    const { skin } = this;
    this.selected = skin === null ? [] : names.map((name) => skin.taxels.indexOf(name)).filter((taxel) => taxel >= 0);
    this.canvas.select(this.selected);
    this.writeTaxel();
  }

  /** Notes that so many frames were left out; null where their number is not known. */
  takeSkipped(frames: number | null): void {
    this.skipped = frames === null || this.skipped === null ? null : this.skipped + frames;
    this.skippedAt = performance.now();
  }

  /** Sorts taxels by how hard they are pressed certainly, hardest first. */
  hardest(taxels: readonly string[]): string[] {
    const { skin, picture } = this;
    if (skin === null || picture === null) return [...taxels];
    const numbers = new Map(skin.taxels.map((name, k) => [name, k]));
    const press = (name: string): number => picture.lo[numbers.get(name) ?? -1] ?? -Infinity;
    return taxels.toSorted((one, other) => press(other) - press(one));
  }

  /** The channels of taxels of the quantity that is shown, and the node that sends each. */
  channelsOf(taxels: readonly string[]): Map<string, string> {
    const { skin } = this;
    if (skin === null) return new Map();
    const found = taxels.map((name) => skin.taxels.indexOf(name)).filter((taxel) => taxel >= 0);
    return new Map(found.map((taxel) => [`${skin.taxels[taxel]}.${skin.quantity}`, skin.nodes[taxel]!]));
  }

  /** Whether the newest frames say what is so now. */
  isPresent(at: number): boolean {
    const { arrivedAt, isPast } = this.options.frames;
    return this.view.kind === "live" && arrivedAt > -Infinity && !isPast && this.silentFor(at) === null;
  }

  /** The window that the time line shows. */
  range(): Range | null {
    const { timeline } = this.options.context;
    if (this.view.kind === "history") return { x0: timeline.toX(this.view.from), x1: timeline.toX(this.view.to) };
    const { end } = this.options.frames.stretches;
    return end === null ? null : { x0: end - this.view.span, x1: end };
  }

  frame(at: number): void {
    if (!this.visible) return;
    const begin = performance.now();
    const texts = this.texts.due(at);
    const live = this.view.kind === "live";

    const position = live ? this.moveLive(at) : this.movePast(at);
    this.movedAt = at;
    this.awaits = !live && this.failure === "" && position !== null && this.reels.at(position) === null;
    this.root.classList.toggle("awaits", this.awaits);
    this.wantGestures(position, at);
    this.draw(position, begin);
    this.film.showPosition(position, this.range(), texts);
    this.film.showPlaying(live || this.playing, live);
    if (texts) this.write(position, at);
  }

  /** Takes over other colours. */
  repaint(): void {
    this.canvas.recolour();
    this.drawn = "";
    this.drawnStrip = "";
    this.showScale();
  }

  /** Off the screen, nothing is drawn. */
  setVisible(visible: boolean): void {
    this.visible = visible;
  }

  destroy(): void {
    this.loading.abort();
    if (this.timer !== null) clearTimeout(this.timer);
    this.reels.clear();
    this.gestures?.destroy();
    this.canvas.destroy();
    this.report.destroy();
  }

  private build(): HTMLElement {
    this.bar.append(this.mark);
    const scale = element(
      "div",
      { class: "skin-scale", "aria-hidden": "true" },
      this.bar,
      element("div", { class: "scale-ends" }, ...this.ends),
    );
    const keys = element(
      "ul",
      { class: "skin-keys" },
      element("li", {}, element("i", { class: "key-colour" }), "colour: lower bound"),
      element("li", {}, element("i", { class: "key-stripes" }), "stripes: upper bound, plain where the interval is wide"),
      element("li", { class: "key-judged" }, element("i", { class: "key-certain" }), "certainly pressed"),
      element("li", { class: "key-judged" }, element("i", { class: "key-possible" }), "possibly pressed"),
      element("li", {}, element("i", { class: "key-unknown" }), "nothing known"),
    );
    const aside = element(
      "div",
      { class: "skin-aside" },
      element("div", { class: "skin-touch" }, this.total, this.list, this.warning),
      this.taxel,
      element("div", { class: "skin-reading" }, this.choice, this.leveled, scale, keys),
      this.counts,
    );
    const stage = element("div", { class: "skin-frame" }, this.canvas.root, this.overlay);
    return element("div", { class: "skin-view", "data-testid": "skin-view", "data-node": this.options.node }, element("div", { class: "skin-body" }, stage, aside), this.film.root, this.spoken);
  }

  private useQuantity(): void {
    const { layout } = this.options.frames;
    if (layout === null) return;
    const skin = skinOf(layout, this.choice.value);
    this.stated = skin.threshold !== null;
    this.root.classList.toggle("stated", this.stated);
    this.root.classList.toggle("few", skin.taxels.length <= FEW);
    this.leveled.hidden = this.stated;
    const usual = skin.unit === "Pa" ? TOUCH_PA : null;
    this.level.set(usual, usual ?? 0, skin.unit);
    this.picture = emptyPicture(skin);
    this.scale = new ColourScale(skin.threshold);
    this.reels.clear();
    this.gestures?.reset();
    this.notices.clear();
    this.judge(skin);
  }

  /** Takes over the level from which a taxel counts as pressed. */
  private useLevel(): void {
    if (this.skin !== null) this.judge(this.skin);
  }

  private judge(skin: Skin): void {
    this.skin = this.stated ? skin : { ...skin, threshold: this.level.value };
    this.root.classList.toggle("judged", this.skin.threshold !== null);
    this.canvas.show(this.skin);
    this.drawn = "";
    this.drawnStrip = "";
    this.showScale();
    this.select(this.options.context.route().taxels ?? []);
  }

  /** Where the live picture is; null where nothing is known of the present. */
  private moveLive(at: number): number | null {
    const { stretches } = this.options.frames;
    const position = this.playback.move(at, stretches.complete, stretches.length);
    return this.isPresent(at) ? position : null;
  }

  /** How long no frame has come, in ms, if that is too long; else null. */
  private silentFor(at: number): number | null {
    const { stretches, arrivedAt } = this.options.frames;
    const silence = at - arrivedAt;
    return silence > Math.max(STALE_MS, (STALE_STRETCHES * stretches.length) / 1e6) ? silence : null;
  }

  private movePast(at: number): number | null {
    const range = this.range();
    if (range === null || this.position === null) return null;
    const { speed } = this.film;
    if (this.playing && !this.film.held) {
      // The film waits for its pictures.
      if (this.reels.at(this.position) !== null) this.position += speed * Math.max(0, at - this.movedAt) * 1e6;
      if (this.position >= range.x1) this.turn(range);
    }
    this.wantFilm(range);
    if (this.rest.position !== this.position) this.rest = { position: this.position, since: at };
    else if (at - this.rest.since > SETTLE_MS && this.asked !== this.position && !this.film.held && this.stated) {
      void this.askContacts(this.position);
    }
    return this.position;
  }

  /** Goes on with the next window; at the newest data, live. */
  private turn(range: Range): void {
    const { context, frames } = this.options;
    const left = (frames.stretches.end ?? context.timeline.now()) - range.x1;
    if (left < LEAST_LEFT) context.go({ ...context.route(), view: { kind: "live", span: DEFAULT_SPAN } });
    else context.showRange(pan(range, Math.min(1, left / (range.x1 - range.x0))));
  }

  /** Asks for gestures of the newest data, or of the past around a position that rests, or that is played slowly. */
  private wantGestures(position: number | null, at: number): void {
    const shared = (this.options.frames.layout?.controllers.length ?? 0) > 1;
    if (this.gestures === null || position === null || !this.stated || shared) return;
    if (this.view.kind === "live") {
      const end = this.options.frames.stretches.complete;
      if (end !== null) this.gestures.wantLive(end, at);
      return;
    }
    const range = this.range();
    const rests = this.rest.position === position && at - this.rest.since > SETTLE_MS;
    if (range === null || this.film.held || !(rests || (this.playing && this.film.speed <= GESTURE_SPEED))) return;
    this.gestures.wantPast(askedOf(range, position), at);
  }

  private wantFilm(range: Range): void {
    if (this.skin === null || this.position === null) return;
    const coarse = (range.x1 - range.x0) / PICTURES;
    const wanted: Wanted[] = [{ x: range.x0, step: coarse }, { x: range.x1, step: coarse }];
    if (!this.film.held) {
      const step = this.playing ? Math.max(this.period, (this.film.speed * 1e9) / FILM_RATE) : this.period;
      if (step < coarse) {
        wanted.push({ x: this.position, step });
        if (this.playing) wanted.push({ x: this.position + step * PICTURES, step });
      }
    }
    this.reels.want(wanted);
  }

  /** From sample to sample, in ns: what is finer holds no sample now and then. */
  private get period(): number {
    return this.options.frames.period ?? 5e7;
  }

  private async askFilm(range: Range, points: number, signal: AbortSignal): Promise<Uint8Array> {
    const { context, node } = this.options;
    const { timeline, client } = context;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(range.x1) };
    return client.frames(node, { ...window, points, quantity: this.skin?.quantity ?? "" }, signal);
  }

  private loaded(): void {
    this.failure = "";
    this.drawn = "";
  }

  private fail(error: unknown): void {
    if (!isAbort(error)) this.failure = messageOf(error);
  }

  /** Puts the position into the window that is shown. */
  private enterPast(): void {
    const range = this.range();
    if (range === null) return;
    if (this.position === null || this.position < range.x0 || this.position > range.x1) {
      this.position = this.playing ? range.x0 : range.x1 - 1;
    }
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.loadContacts(range), SETTLE_MS);
  }

  private async loadContacts(range: Range): Promise<void> {
    this.loading.abort();
    this.loading = new AbortController();
    const { client, timeline } = this.options.context;
    const window = { start: timeline.toInstant(range.x0), end: timeline.toInstant(Math.ceil(range.x1)), points: CONTACT_POINTS };
    try {
      const found = await client.contacts(this.options.node, window, this.loading.signal);
      for (const one of found) this.past.put(contactsAt(one, timeline));
      this.drawnStrip = "";
    } catch (error) {
      this.fail(error);
    }
  }

  /** Asks for the contacts of the very instant at which the film stands still. */
  private async askContacts(position: number): Promise<void> {
    const { client, timeline } = this.options.context;
    this.asked = position;
    const window = { start: timeline.toInstant(position - this.period), end: timeline.toInstant(position) + 1n, points: 1 };
    try {
      const found = await client.contacts(this.options.node, window, this.loading.signal);
      for (const one of found) this.past.put(contactsAt(one, timeline));
      this.redraw();
    } catch (error) {
      this.fail(error);
    }
  }

  /** Plays or pauses; from live, the film stops at what is shown just now. */
  private toggle(): void {
    if (this.view.kind === "live") {
      const position = this.playback.position;
      const range = this.range();
      if (range === null || position === null) return;
      this.position = position;
      this.playing = false;
      this.options.context.showRange(range);
      return;
    }
    const range = this.range();
    this.playing = !this.playing;
    if (this.playing && range !== null && this.position !== null && this.position >= range.x1 - 2 * this.period) this.position = range.x0;
  }

  private scrub(x: number): void {
    const range = this.range();
    if (range === null) return;
    this.position = Math.max(range.x0, Math.min(range.x1 - 1, x));
    if (this.view.kind === "live") {
      this.playing = false;
      this.options.context.showRange(range);
    }
  }

  private redraw(): void {
    this.drawn = "";
    this.drawnStrip = "";
  }

  /** Draws the picture of an instant, unless it is the one that is there. */
  private draw(position: number | null, begin: number): void {
    const { skin, picture } = this;
    if (skin === null || picture === null) return;
    const live = this.view.kind === "live";
    const source = position === null ? null : live ? this.options.frames.stretches : (this.reels.at(position)?.stretches ?? null);
    const name = source === null ? "unknown" : `${live ? "live" : (this.reels.at(position!)?.key ?? "")} ${source.nameAt(position!)}`;
    if (name === this.drawn) return;
    if (source === null) {
      picture.lo.fill(-Infinity);
      picture.hi.fill(Infinity);
      picture.newest = Number.NaN;
    } else source.read(skin, position!, picture);
    if (this.scale.grow(picture.lo, picture.hi)) {
      this.canvas.invalidate();
      this.fitLevel(skin.unit);
      this.showScale();
    }
    if (!this.canvas.paint(picture, this.scale)) return;
    this.drawn = name;
    this.pictures += 1;
    this.shownContacts = position === null || Number.isNaN(picture.newest) ? null : this.contactsAt(position);
    this.canvas.label(this.shownContacts);
    this.canvas.mark(position === null ? [] : (this.gestures?.at(position, live) ?? []));
    this.root.dataset["pictures"] = String(this.pictures);
    if (Number.isNaN(picture.newest)) return;
    const sample = this.options.context.timeline.toInstant(picture.newest);
    this.root.dataset["newest"] = String(sample);
    this.report.drawn(this.options.node, sample, begin);
  }

  /** Shows an empty level in the prefix of what is measured. */
  private fitLevel(unit: string): void {
    if (this.level.value === null) this.level.set(null, Math.max(Math.abs(this.scale.lo), Math.abs(this.scale.hi)), unit);
  }

  private contactsAt(position: number): ContactsAt | null {
    if (this.view.kind === "live") {
      const { contacts, stretches } = this.options.frames;
      return contacts.at(position, Math.max(LEAST_REACH, 1.5 * stretches.length));
    }
    return this.past.at(position, LEAST_REACH);
  }

  private write(position: number | null, at: number): void {
    const range = this.range();
    const live = this.view.kind === "live";
    const strip = `${range?.x0} ${range?.x1}`;
    if (strip !== this.drawnStrip) {
      this.drawnStrip = strip;
      this.film.paint(live ? this.options.frames.contacts.all : this.past.all, range, this.stated);
    }
    this.writeContacts();
    this.gestures?.write(position);
    this.writeTaxel();
    this.writeState(at);
    if (this.speech.due(at)) setText(this.spoken, this.say(position));
  }

  /** Without a statement there is no contact, unless a taxel is unknown: it may be pressed. */
  private knowsContacts(): boolean {
    if (this.picture === null || Number.isNaN(this.picture.newest)) return false;
    return this.shownContacts !== null || !this.canvas.verdicts.includes(UNKNOWN);
  }

  private writeContacts(): void {
    if (this.awaits) {
      setText(this.total, "Loading…");
      this.list.replaceChildren();
      return;
    }
    if (!this.stated) {
      setText(this.total, this.judgedText());
      this.list.replaceChildren();
      return;
    }
    const found = this.shownContacts;
    const total = found === null ? { lo: 0, hi: 0 } : totalOf(found);
    const known = this.knowsContacts();
    setText(this.total, known ? (total.hi === 0 ? "No contact" : `${formatCount(total)} contact${total.hi === 1 ? "" : "s"}`) : "Contacts unknown");
    const cores = known ? (found?.cores.slice(0, LISTED) ?? []) : [];
    while (this.list.children.length > cores.length) this.list.lastElementChild!.remove();
    for (const [index, core] of cores.entries()) {
      const item = this.list.children[index] as HTMLElement | undefined;
      const text = [forceText(core), `${formatCount(boundsOf(core.cells))} ${core.cells[1] === 1 ? "taxel" : "taxels"}`];
      if (item === undefined) this.list.append(element("li", {}, element("b", {}, text[0]), element("span", {}, text[1])));
      else for (const [part, words] of text.entries()) setText(item.children[part] as HTMLElement, words);
    }
  }

  /** How many taxels are above the level that was typed; without one, the hull of all that are known. */
  private judgedText(): string {
    const { skin, picture } = this;
    if (skin === null || picture === null || Number.isNaN(picture.newest)) return "Nothing known";
    const counts = this.counted();
    if (skin.threshold === null) {
      let [lo, hi] = [Infinity, -Infinity];
      for (const [k, verdict] of this.canvas.verdicts.entries()) {
        if (verdict === UNKNOWN) continue;
        lo = Math.min(lo, picture.lo[k]!);
        hi = Math.max(hi, picture.hi[k]!);
      }
      return lo > hi ? "Nothing known" : formatInterval({ lo, hi }, skin.unit);
    }
    const certain = counts[CERTAIN]!;
    const most = certain + counts[POSSIBLE]! + counts[UNKNOWN]!;
    return `${formatCount({ lo: certain, hi: most })} of ${skin.taxels.length.toLocaleString("en")} pressed`;
  }

  /** How many taxels have each verdict. */
  private counted(): number[] {
    const counts = [0, 0, 0, 0];
    for (const verdict of this.canvas.verdicts) counts[verdict]! += 1;
    return counts;
  }

  private writeTaxel(): void {
    const taxel = this.pointed ?? this.selected[0] ?? null;
    if (taxel === null) setText(this.taxel, "Click a taxel, or drag a box around some, for their charts.");
    else setText(this.taxel, this.describe(taxel));
  }

  /** A taxel's interval in words. */
  private describe(taxel: number): string {
    const { skin, picture } = this;
    if (skin === null || picture === null) return "";
    const interval = { lo: picture.lo[taxel]!, hi: picture.hi[taxel]! };
    const verdict = this.canvas.verdicts[taxel] ?? UNKNOWN;
    const words = verdict === CERTAIN ? ", certainly pressed" : verdict === POSSIBLE ? ", possibly pressed" : "";
    const text = this.awaits ? "loading" : verdict === UNKNOWN ? "unknown" : formatInterval(interval, skin.unit);
    return `${skin.taxels[taxel]}: ${text}${words}`;
  }

  private writeState(at: number): void {
    const counts = this.counted();
    const judged = this.skin?.threshold === null ? [] : [`${counts[CERTAIN]!.toLocaleString("en")} certain`, `${counts[POSSIBLE]!.toLocaleString("en")} possible`];
    const taxels = this.skin?.taxels.length ?? 0;
    const known = this.awaits ? [] : [...judged, `${counts[UNKNOWN]!.toLocaleString("en")} unknown`];
    setText(this.counts, [`${taxels.toLocaleString("en")} taxels`, ...known].join(" · "));
    if (this.skin === null) return;
    const { arrivedAt, late, isPast } = this.options.frames;
    const slow = this.view.kind === "live" && at - this.skippedAt < SKIPPED_MS;
    if (!slow) this.skipped = 0;
    const behind = this.view.kind === "live" && late > LATE_NS;
    const words = [
      behind ? `Data comes ${formatDuration(late, "down")} late.` : "",
      slow ? leftOut(this.skipped) : "",
    ];
    setText(this.warning, words.filter(Boolean).join(" "));
    if (this.view.kind === "history") {
      if (this.failure) this.notices.show("error", "The film could not be loaded", this.failure);
      else if (this.awaits) this.notices.show("loading", "Loading pictures…", "");
      else this.notices.clear();
      return;
    }
    const silence = this.silentFor(at);
    if (arrivedAt === -Infinity) this.notices.show("empty", "No data yet", "The skin appears here with the node's next frame.");
    else if (silence !== null) this.notices.show("stale", "No data now", `The last frame came ${formatDuration(Math.floor(silence / 1000) * 1e9)} ago. What the skin feels now is unknown.`);
    else if (isPast) this.notices.show("stale", "No data of now", `What comes was measured ${formatDuration(late, "down")} ago at least. What the skin feels now is unknown.`);
    else this.notices.clear();
  }

  private say(position: number | null): string {
    if (this.awaits) return "Pictures are loading.";
    const taxel = this.pointed ?? this.selected[0] ?? null;
    const contacts = position === null ? "Nothing is known of the skin." : this.stated ? (this.knowsContacts() ? describeContacts(this.shownContacts) : "Contacts are unknown.") : `${this.judgedText().replace("–", " to ")}.`;
    return taxel === null ? contacts : `${contacts} ${this.describe(taxel).replace("–", " to ")}.`;
  }

  private showScale(): void {
    const { skin, scale } = this;
    if (skin === null) return;
    const colours = getComputedStyle(document.documentElement).getPropertyValue("--skin-values").trim().split(/\s+/);
    this.bar.style.background = `linear-gradient(to right, ${colours.join(", ")})`;
    this.root.style.setProperty("--skin-middle", colours[2]!);
    this.root.style.setProperty("--skin-high", colours.at(-1)!);
    const { labels, unit } = formatTicks([scale.lo, (scale.lo + scale.hi) / 2, scale.hi], skin.unit);
    for (const [index, end] of this.ends.entries()) setText(end, index === 2 ? `${labels[index]} ${unit}` : labels[index]!);
    this.mark.hidden = skin.threshold === null;
    if (skin.threshold === null) return;
    this.mark.style.left = `${(100 * (skin.threshold - scale.lo)) / (scale.hi - scale.lo || 1)}%`;
    this.mark.title = `contact from ${formatInterval({ lo: skin.threshold, hi: skin.threshold }, skin.unit)} on`;
  }

  private choose(taxels: readonly number[], adds: boolean): void {
    const { skin } = this;
    if (skin !== null) this.options.onSelect(taxels.map((taxel) => skin.taxels[taxel]!), adds);
  }

  private point(taxel: number | null): void {
    this.pointed = taxel;
    this.writeTaxel();
    // Who works by keys hears it at once.
    if (taxel !== null && this.canvas.root === document.activeElement) this.speech.reset();
  }
}
