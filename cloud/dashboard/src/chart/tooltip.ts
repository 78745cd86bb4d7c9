import { element } from "../view/element";

export interface TipLine {
  readonly name: string;
  readonly value: string;
}

/** The content of a tooltip: a title and named lines. */
export interface TipText {
  readonly title: string;
  readonly kind?: string;
  readonly lines: readonly TipLine[];
}

const DISTANCE = 14;

/** A small box beside the cursor. It is also read out, politely, when the keyboard moves the cursor. */
export class Tooltip {
  private readonly box = element("div", { class: "tooltip", "data-testid": "tooltip", hidden: true });
  private readonly spoken = element("div", { class: "unseen", "aria-live": "polite" });

  /** @param onDismiss called when Escape is pressed: the box may cover the chart */
  constructor(private readonly root: HTMLElement, private readonly onDismiss: () => void) {
    root.append(this.box, this.spoken);
  }

  /** Shows the text beside a point of the root, on the side where there is room. */
  show(text: TipText, at: { x: number; y: number }, speak: boolean): void {
    const list = element("dl");
    for (const { name, value } of text.lines) list.append(element("dt", {}, name), element("dd", {}, value));
    const title = element("strong", {}, text.title);
    this.box.replaceChildren(title, ...(text.kind ? [element("span", { class: "tip-kind" }, text.kind)] : []), list);
    this.box.hidden = false;
    addEventListener("keydown", this.onKey);
    const room = this.root.clientWidth;
    const width = this.box.offsetWidth;
    const right = at.x + DISTANCE + width <= room;
    const left = right ? at.x + DISTANCE : Math.max(0, at.x - DISTANCE - width);
    const top = Math.max(0, Math.min(at.y, this.root.clientHeight - this.box.offsetHeight));
    this.box.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
    if (speak) {
      this.spoken.textContent = [text.title, text.kind, ...text.lines.map((line) => `${line.name} ${line.value}`)]
        .filter(Boolean)
        .join(", ");
    }
  }

  hide(): void {
    this.box.hidden = true;
    removeEventListener("keydown", this.onKey);
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    if (event.key === "Escape") this.onDismiss();
  };
}
