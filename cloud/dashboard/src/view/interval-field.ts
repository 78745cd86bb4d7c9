import type { ModelParameter } from "../api/contract";
import { decimalExponent } from "../interval/decimal";
import { isMissing, type Interval } from "../interval/interval";
import { parseTyped, printTyped } from "../interval/typed";
import { choosePrefix, findUnit } from "../interval/unit";
import { element, setText } from "./element";

/** Input of a parameter's bounds: two numbers in a fitting prefix; one alone stands for both. */
export class IntervalField {
  readonly root: HTMLElement;
  private exponent = 0;
  private readonly lo: HTMLInputElement;
  private readonly hi: HTMLInputElement;
  private readonly unitLabel = element("span", { class: "unit-after", "aria-hidden": "true" });
  private readonly label: string;

  /** @param code the UCUM code of the unit */
  constructor(readonly parameter: ModelParameter, private readonly code: string) {
    this.label = parameter.name.replaceAll("_", " ");
    this.lo = this.input("lo");
    this.hi = this.input("hi");
    const bounds = element("span", { class: "bounds" }, this.lo, element("span", { "aria-hidden": "true" }, "–"), this.hi, this.unitLabel);
    this.root = element("div", { class: "interval-field", role: "group", "aria-label": this.label }, element("span", { class: "name", "aria-hidden": "true" }, this.label), bounds);
    this.set(null);
  }

  /** Shows bounds, or empty fields. */
  set(value: Interval | null): void {
    const finite = value === null || isMissing(value) ? [] : [value.lo, value.hi].filter(Number.isFinite).map(Math.abs);
    const unit = findUnit(this.code);
    const largest = Math.max(0, ...finite);
    const prefix = choosePrefix(unit, largest > 0 ? decimalExponent(largest) : 0);
    this.exponent = prefix.exponent;
    const symbol = `${prefix.symbol}${unit.symbol}`;
    setText(this.unitLabel, symbol);
    for (const [input, bound, name] of [[this.lo, value?.lo, "lower"], [this.hi, value?.hi, "upper"]] as const) {
      input.value = bound === undefined || !Number.isFinite(bound) ? "" : printTyped(bound, this.exponent);
      input.setAttribute("aria-label", [`${this.label}, ${name} bound`, symbol].filter(Boolean).join(", in "));
      input.removeAttribute("aria-invalid");
    }
  }

  /** What is typed; null where it is no interval, which is then marked. */
  read(): Interval | null {
    const [first, second] = [this.lo.value.trim(), this.hi.value.trim()];
    const lo = parseTyped(first || second, this.exponent);
    const hi = parseTyped(second || first, this.exponent);
    const turned = lo !== null && hi !== null && lo > hi;
    this.lo.setAttribute("aria-invalid", String(lo === null || turned));
    this.hi.setAttribute("aria-invalid", String(hi === null || turned));
    return lo === null || hi === null || turned ? null : { lo, hi };
  }

  get name(): string {
    return this.label;
  }

  /** Whether both fields are empty. */
  get empty(): boolean {
    return this.lo.value.trim() === "" && this.hi.value.trim() === "";
  }

  focus(): void {
    this.lo.focus();
  }

  private input(side: "lo" | "hi"): HTMLInputElement {
    return element("input", { type: "text", inputmode: "decimal", autocomplete: "off", placeholder: side, "data-testid": `model-${this.parameter.name}-${side}` });
  }
}
