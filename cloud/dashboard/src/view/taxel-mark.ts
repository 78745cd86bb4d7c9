const SPACE = "http://www.w3.org/2000/svg";

function svgElement(tag: string, attributes: Readonly<Record<string, string | number>>): SVGElement {
  const made = document.createElementNS(SPACE, tag) as SVGElement;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  return made;
}

/** An empty picture of a skin. */
export function drawing(width: number, height: number): SVGSVGElement {
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, class: "skin-map", role: "group" });
  svg.style.aspectRatio = `${width} / ${height}`;
  return svg as SVGSVGElement;
}

/**
 * A taxel: a disc when its contact is certain, a dashed ring with a dot when it is possible, a small
 * ring when there is none, a cross when nothing is known. The style sheet shows one shape of them.
 */
export function taxelMark(taxel: string, at: { x: number; y: number; radius: number }): SVGElement {
  const { x, y, radius } = at;
  const mark = svgElement("a", { class: "taxel-mark" });
  mark.dataset["testid"] = "taxel";
  mark.dataset["taxel"] = taxel;
  const cross = 0.35 * radius;
  mark.append(
    svgElement("title", {}),
    svgElement("circle", { class: "ground", cx: x, cy: y, r: radius }),
    svgElement("circle", { class: "shape certain", cx: x, cy: y, r: 0.86 * radius }),
    svgElement("circle", { class: "shape possible", cx: x, cy: y, r: 0.74 * radius }),
    svgElement("circle", { class: "shape possible dot", cx: x, cy: y, r: 0.28 * radius }),
    svgElement("circle", { class: "shape none", cx: x, cy: y, r: 0.3 * radius }),
    svgElement("path", { class: "shape unknown", d: `M${x - cross} ${y - cross} l${2 * cross} ${2 * cross} m0 ${-2 * cross} l${-2 * cross} ${2 * cross}` }),
  );
  return mark;
}
