import { decimalExponent } from "../interval/decimal";
import { parseTyped, shortTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import { element } from "./element";

/** Input of a level, in the prefix of the magnitude of what is measured; it may be left empty. */
export class LevelField {
  readonly root: HTMLElement;
  value: number | null = null;
  private exponent = 0;
  private readonly input = element("input", { type: "text", inputmode: "decimal", autocomplete: "off", placeholder: "level", "aria-label": "level", "data-testid": "skin-level" });
  private readonly unit = element("span", { class: "unit" });

  constructor(onChange: () => void) {
    this.root = element("span", { class: "with-unit" }, this.input, this.unit);
    this.input.addEventListener("input", () => {
      const empty = this.input.value.trim() === "";
      const typed = empty ? null : parseTyped(this.input.value, this.exponent);
      this.input.setAttribute("aria-invalid", String(typed === null && !empty));
      if (typed === null && !empty) return;
      this.value = typed;
      onChange();
    });
  }

  /**
   * Shows a level, or none.
   *
   * @param magnitude of what is measured
   * @param code the UCUM code of the unit
   */
  set(level: number | null, magnitude: number, code: string): void {
    const unit = findUnit(code);
    const prefix = choosePrefix(unit, magnitude > 0 ? decimalExponent(magnitude) : 0);
    this.exponent = prefix.exponent;
    // Three digits are shown, and those are meant.
    const shown = level === null ? null : shortTyped(level, prefix.exponent, 3);
    this.value = shown && shown.value;
    this.input.value = shown?.text ?? "";
    this.input.setAttribute("aria-invalid", "false");
    this.unit.textContent = `${prefix.symbol}${unit.symbol}`;
  }
}
