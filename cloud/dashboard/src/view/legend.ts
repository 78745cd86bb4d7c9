import { element } from "./element";
import { verdictSymbol } from "./symbol";

/** One line that explains how to read a chart. */
export function legend(): HTMLElement {
  return element(
    "p",
    { class: "legend", "data-testid": "legend" },
    element("span", { class: "key" }, element("i", { class: "swatch band" }), element("b", {}, "band"), " encloses the true value at every sample"),
    element("span", { class: "key" }, verdictSymbol("certain"), element("b", {}, "certain"), " holds for every value in the band"),
    element("span", { class: "key" }, verdictSymbol("possible"), element("b", {}, "possible"), " holds for some; 0–3 is how many"),
    element("span", { class: "key" }, element("i", { class: "swatch missing" }), element("b", {}, "hatched"), " nothing known"),
  );
}
