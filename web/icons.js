// Icons of `icons.svg`, in the colour of the text around them.

const SVG = "http://www.w3.org/2000/svg";

/** An icon by its name there; the words beside it, or its button's label, say what it means. */
export function icon(name) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(SVG, "use");
  use.setAttribute("href", `icons.svg#${name}`);
  svg.append(use);
  return svg;
}
