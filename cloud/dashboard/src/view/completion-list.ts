import { type Choice, complete, isComplete, type Offer } from "./formula-completion";
import { element } from "./element";

let made = 0;

/**
 * Offers what may be written next in a text field, as a combobox with a list: arrows choose, Enter and Tab accept,
 * Escape closes. With no choice made, keys do what they do in any field.
 */
export class CompletionList {
  readonly root: HTMLElement;
  private readonly list: HTMLElement;
  private offer: Offer = { from: 0, word: "", choices: [] };
  private active = -1;
  private readonly id = `completions-${(made += 1)}`;

  /** @param offered what may be written at a caret of the field's text */
  constructor(private readonly field: HTMLInputElement, private readonly offered: (text: string, caret: number) => Offer) {
    this.list = element("ul", { class: "completions", role: "listbox", id: this.id, "aria-label": "completions", hidden: true, "data-testid": "completions" });
    for (const [name, value] of [["role", "combobox"], ["aria-autocomplete", "list"], ["aria-expanded", "false"], ["aria-controls", this.id]] as const) field.setAttribute(name, value);
    this.root = element("div", { class: "completed" }, field, this.list);
    field.addEventListener("input", () => this.look(false));
    field.addEventListener("click", () => this.close());
    field.addEventListener("blur", () => this.close());
    field.addEventListener("keydown", (event) => this.onKey(event));
  }

  private get isOpen(): boolean {
    return !this.list.hidden;
  }

  /** Offers what fits the caret; where nothing was begun, only when it is wanted. */
  private look(wanted: boolean): void {
    const caret = this.field.selectionStart ?? this.field.value.length;
    this.offer = this.offered(this.field.value, caret);
    const { word, choices } = this.offer;
    const afterNumber = choices[0]?.kind === "unit" && this.field.value[caret - 1] === " ";
    if (choices.length === 0 || (!wanted && (isComplete(this.offer) || (word === "" && !afterNumber)))) {
      this.close();
      return;
    }
    this.list.replaceChildren(...choices.map((choice, index) => this.option(choice, index)));
    this.list.hidden = false;
    this.field.setAttribute("aria-expanded", "true");
    this.choose(word === "" ? -1 : 0);
  }

  private option({ label, kind }: Choice, index: number): HTMLElement {
    const row = element("li", { role: "option", id: `${this.id}-${index}`, "aria-selected": "false" }, element("span", {}, label), " ", element("span", { class: "kind" }, kind));
    // The field keeps the focus.
    row.addEventListener("pointerdown", (event) => event.preventDefault());
    row.addEventListener("click", () => this.accept(index));
    return row;
  }

  private choose(index: number): void {
    this.active = index;
    for (const [at, row] of [...this.list.children].entries()) {
      row.setAttribute("aria-selected", String(at === index));
      if (at === index) row.scrollIntoView({ block: "nearest" });
    }
    if (index < 0) this.field.removeAttribute("aria-activedescendant");
    else this.field.setAttribute("aria-activedescendant", `${this.id}-${index}`);
  }

  private close(): void {
    this.list.hidden = true;
    this.field.setAttribute("aria-expanded", "false");
    this.choose(-1);
  }

  private accept(index: number): void {
    const choice = this.offer.choices[index];
    if (!choice) return;
    const { text, caret } = complete(this.field.value, this.field.selectionStart ?? this.field.value.length, this.offer, choice);
    this.field.value = text;
    this.field.setSelectionRange(caret, caret);
    this.field.focus();
    this.close();
  }

  private onKey(event: KeyboardEvent): void {
    const { key } = event;
    const count = this.offer.choices.length;
    if (key === "ArrowDown" || key === "ArrowUp") {
      event.preventDefault();
      if (this.isOpen) this.choose(key === "ArrowDown" ? (this.active + 1) % count : (this.active <= 0 ? count : this.active) - 1);
      else if (key === "ArrowDown") {
        this.look(true);
        if (this.isOpen && this.active < 0) this.choose(0);
      }
    } else if (this.isOpen && this.active >= 0 && (key === "Enter" || (key === "Tab" && !event.shiftKey))) {
      event.preventDefault();
      this.accept(this.active);
    } else if (this.isOpen && key === "Escape") {
      event.stopPropagation();
      this.close();
    } else if (["ArrowLeft", "ArrowRight", "Home", "End"].includes(key)) this.close();
  }
}
