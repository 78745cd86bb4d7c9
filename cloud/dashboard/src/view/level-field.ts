import { decimalExponent } from "../interval/decimal";
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
      const typed = Number(this.input.value.trim().replace(",", "."));
      const valid = this.input.value.trim() !== "" && Number.isFinite(typed);
      this.input.setAttribute("aria-invalid", String(!valid));
      if (!valid) return;
      this.value = typed * 10 ** this.exponent;
      onChange();
    });
  }

  /** Shows a level in its unit. */
  set(level: number, code: string): void {
    const unit = findUnit(code);
    const prefix = choosePrefix(unit, level === 0 ? 0 : decimalExponent(Math.abs(level)));
    this.exponent = prefix.exponent;
    // Three digits are shown, and those are meant.
    const shown = Number((level / 10 ** prefix.exponent).toPrecision(3));
    this.value = shown * 10 ** prefix.exponent;
    this.input.value = String(shown);
    this.input.setAttribute("aria-invalid", "false");
    this.unit.textContent = `${prefix.symbol}${unit.symbol}`;
  }
}
