import { decimalExponent } from "../interval/decimal";
import { parseTyped, shortTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import { element } from "./element";

/** A level that people type in the prefix of its magnitude. */
export class LevelField {
  readonly root: HTMLElement;
  value = 0;
  private exponent = 0;
  private readonly input = element("input", { type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": "level", "data-testid": "skin-level" });
  private readonly unit = element("span", { class: "unit" });

  constructor(onChange: () => void) {
    this.root = element("span", { class: "with-unit" }, this.input, this.unit);
    this.input.addEventListener("input", () => {
      const typed = parseTyped(this.input.value, this.exponent);
      this.input.setAttribute("aria-invalid", String(typed === null));
      if (typed === null) return;
      this.value = typed;
      onChange();
    });
  }

  /** Shows a level in its unit. */
  set(level: number, code: string): void {
    const unit = findUnit(code);
    const prefix = choosePrefix(unit, level === 0 ? 0 : decimalExponent(Math.abs(level)));
    this.exponent = prefix.exponent;
    // Three digits are shown, and those are meant.
    const { text, value } = shortTyped(level, prefix.exponent, 3);
    this.value = value;
    this.input.value = text;
    this.input.setAttribute("aria-invalid", "false");
    this.unit.textContent = `${prefix.symbol}${unit.symbol}`;
  }
}
