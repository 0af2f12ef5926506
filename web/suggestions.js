// Places worth driving to, because seeing them again would settle an uncertain stretch of the path: numbered on the map,
// and as a list whose entries propose a goal.

import { colour } from "./canvas.js";
import { layer } from "./layers.js";

layer("suggestions", { label: "Suggested places", z: 46, draw: drawPlaces });

function drawPlaces(context, { pixel }, { header }) {
  context.font = "700 11px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  header.suggestions.forEach(({ x, y }, index) => {
    context.save();
    context.translate(x, y);
    context.scale(pixel, -pixel); // letters stand upright and keep their size
    context.beginPath();
    context.arc(0, 0, 10, 0, 7);
    context.fillStyle = colour("panel");
    context.fill();
    context.lineWidth = 2.5;
    context.strokeStyle = colour("open");
    context.stroke();
    context.fillStyle = colour("ink");
    context.fillText(String(index + 1), 0, 0.5);
    context.restore();
  });
}

/** The list: a button that says how many places there are, and unfolds them. */
export class Suggestions {
  constructor(box, connection, propose) {
    this.box = box;
    this.propose = propose; // called with [x, y] in the world
    this.button = document.createElement("button");
    this.button.type = "button";
    this.button.setAttribute("aria-controls", "suggestions-list");
    this.button.onclick = () => this.open(this.list.hidden);
    this.list = document.createElement("ol");
    this.list.id = "suggestions-list";
    box.replaceChildren(this.button, this.list);
    this.open(false);
    connection.addEventListener("suggestions", ({ detail }) => this.show(detail.header.suggestions));
  }

  open(isOpen) {
    this.list.hidden = !isOpen;
    this.button.setAttribute("aria-expanded", String(isOpen));
  }

  show(suggestions) {
    this.box.hidden = suggestions.length === 0;
    const n = suggestions.length;
    this.button.textContent = n === 1 ? "1 place worth seeing again" : `${n} places worth seeing again`;
    const held = [...this.list.querySelectorAll("button")].indexOf(document.activeElement);
    this.list.replaceChildren(...suggestions.map((suggestion) => this.entry(suggestion)));
    if (held >= 0) (this.list.querySelectorAll("button")[held] ?? this.button).focus();
  }

  entry({ x, y, text }) {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = text;
    button.onclick = () => this.propose([x, y]);
    item.append(button);
    return item;
  }
}
