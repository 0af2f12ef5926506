// Names of places on the live map: drawn where the map has them now, given and taken away at the card of a clicked place.

import { colour } from "./canvas.js";
import { element } from "./elements.js";
import { layer } from "./layers.js";
import { ask, sentence } from "./rest.js";
import { toast } from "./toast.js";

const NEAR = 16; // pixels around a label that count as it
const LONGEST = 80; // letters

layer("labels", { label: "Names of places", z: 47, draw: drawLabels });

function drawLabels(context, { pixel }, { header }) {
  for (const { text, x, y } of header.labels) drawName(context, pixel, text, x, y);
}

/** A dot at a place and its name above it, upright and always of one size. */
export function drawName(context, pixel, text, x, y) {
  context.save();
  context.translate(x, y);
  context.scale(pixel, -pixel);
  context.font = "600 12.5px system-ui, sans-serif";
  context.textAlign = "center";
  const width = context.measureText(text).width + 12;
  context.fillStyle = colour("panel");
  context.globalAlpha = 0.85;
  context.beginPath();
  context.roundRect(-width / 2, -28, width, 19, 6);
  context.fill();
  context.globalAlpha = 1;
  context.fillStyle = colour("ink");
  context.beginPath();
  context.arc(0, 0, 4, 0, 7);
  context.fill();
  context.fillText(text, 0, -14);
  context.restore();
}

/** What the card of a clicked place offers besides driving there: to name it, or to take its name away. */
export class PlaceNames {
  constructor(card, map, close) {
    this.map = map;
    this.close = close; // takes the card away
    this.near = null; // the label at the place
    this.button = element("button", { type: "button", onclick: () => (this.near ? this.remove(this.near) : this.open()) });
    this.input = element("input", { type: "text", maxLength: LONGEST, required: true, "aria-label": "Name of this place", placeholder: "Name of this place" });
    this.form = element("form", { class: "row", hidden: true }, this.input, element("button", { type: "submit", class: "primary" }, "Save name"));
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.add(this.input.value, this.map.candidate);
    };
    card.append(this.button, this.form);
  }

  /** Another place was clicked. */
  offer([x, y]) {
    const labels = this.map.frames.labels?.header.labels ?? [];
    const apart = (label) => Math.hypot(label.x - x, label.y - y);
    const nearest = labels.toSorted((one, other) => apart(one) - apart(other))[0];
    this.near = nearest && apart(nearest) * this.map.scale < NEAR ? nearest : null;
    this.button.textContent = this.near ? `Remove “${this.near.text}”` : "Name it";
    this.button.hidden = false;
    this.form.hidden = true;
    this.input.value = "";
  }

  open() {
    this.button.hidden = true;
    this.form.hidden = false;
    this.input.focus();
  }

  async add(text, place) {
    const [x, y] = place;
    try {
      await ask("labels", { method: "POST", body: { text: text.trim(), x, y } });
      if (this.map.candidate === place) this.close(); // another place may have been clicked meanwhile
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
    }
  }

  async remove({ id, text, x, y }) {
    this.close();
    try {
      await ask(`labels/${id}`, { method: "DELETE" });
      toast(`“${text}” removed`, { label: "Undo", run: () => this.add(text, [x, y]) });
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
    }
  }
}
