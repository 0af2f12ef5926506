// One saved map: looked at, named, turned, labelled, compared and downloaded. Every change is saved at once.

import { element } from "./elements.js";
import { icon } from "./icons.js";
import { Plan } from "./plan.js";
import { compose, wrap } from "./pose.js";
import { ask, sentence } from "./rest.js";
import { toast } from "./toast.js";

const DEGREE = Math.PI / 180;
const FORMATS = {
  png: "picture", pgm: "grid for ROS", yaml: "its frame, for ROS", json: "walls and path", g2o: "pose graph", tum: "path with times",
  csv: "certainty", zip: "all of these",
};
const PROMPTS = {
  origin: "Click where the map's origin is to be, or move the cross there and press Enter.",
  label: "Click the place that you want to name, or move the cross there and press Enter.",
};

export class MapSheet {
  constructor(box, onClose) {
    this.box = box;
    this.onClose = onClose; // called with the map's number if it was deleted
    this.map = null; // as REST has it
    this.tool = null; // "origin" or "label"
    this.saving = Promise.resolve(); // the changes that are under way
    this.build();
  }

  build() {
    this.name = element("input", { type: "text", maxLength: 120, class: "map-name", "aria-label": "Name of the map" });
    this.name.onchange = () => this.change({ name: this.name.value.trim() || this.map.name });
    this.name.onkeydown = ({ code }) => code === "Enter" && this.name.blur();
    this.figures = element("p", { class: "figures" });
    this.canvas = element("canvas", { tabIndex: 0, role: "img" });
    this.prompt = element("p", { class: "map-prompt", role: "status", hidden: true });
    this.legend = element("ul", { class: "legend" });
    this.plan = new Plan(this.canvas, (place) => this.place(place));
    this.stage = element("div", { class: "stage card" }, this.canvas, this.prompt, this.legend);
    const tools = element("div", { class: "tools" },
      button("Fit", "fit", () => this.plan.fit()),
      element("button", { type: "button", "aria-label": "Zoom in", onclick: () => this.plan.zoom(1.35) }, icon("plus")),
      element("button", { type: "button", "aria-label": "Zoom out", onclick: () => this.plan.zoom(1 / 1.35) }, icon("minus")));
    this.back = element("button", { type: "button", onclick: () => this.close() }, "← All maps");
    this.box.replaceChildren(
      element("div", { class: "map-head" }, this.back, this.name, this.figures, tools),
      element("div", { class: "map-body" },
        this.stage,
        element("div", { class: "map-side" }, this.frameSection(), this.labelSection(), this.compareSection(), this.noteSection(), this.fileSection())));
  }

  frameSection() {
    this.turned = element("input", { type: "number", step: "1", min: "-180", max: "180" });
    this.turned.onchange = () => this.turn(() => -DEGREE * Number(this.turned.value), "Turned");
    this.origin = button("Set origin", null, () => this.choose("origin"));
    return section("Frame",
      element("div", { class: "row" },
        button("Straighten", null, () => this.turn(({ frame, skew_rad }) => frame.theta + skew_rad, "Straightened")),
        button("Quarter turn", "turn", () => this.turn(({ frame }) => frame.theta - Math.PI / 2, "Turned")),
        this.origin,
        button("As it was made", null, () => this.setFrame(() => [0, 0, 0], "The map is as the robot made it"))),
      element("label", { class: "inline" }, "Turned by", this.turned, "degrees"));
  }

  labelSection() {
    this.labels = element("ul", { class: "map-labels" });
    this.label = button("Name a place", "label", () => this.choose("label"));
    this.text = element("input", { type: "text", maxLength: 80, required: true, "aria-label": "Name of this place", placeholder: "Name of this place" });
    this.form = element("form", { class: "row", hidden: true }, this.text, element("button", { type: "submit", class: "primary" }, "Save name"));
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.addLabel(this.text.value.trim());
    };
    return section("Places", this.labels, this.form, element("div", { class: "row" }, this.label));
  }

  compareSection() {
    this.other = element("select", { "aria-label": "Compare with another map", onchange: () => this.compare() });
    this.isAligned = element("input", { type: "checkbox", checked: true, onchange: () => this.compare() });
    this.shares = element("p", { class: "note", role: "status" });
    this.picture = element("a", { class: "button", target: "_blank", rel: "noopener", hidden: true }, icon("download"), "Picture of both");
    return section("Compare", this.other,
      element("label", { class: "inline" }, this.isAligned, "find how they lie to each other"), this.shares, this.picture);
  }

  noteSection() {
    this.note = element("textarea", { rows: 3, maxLength: 4000, "aria-label": "Note", placeholder: "What there is to know about this map" });
    this.note.onchange = () => this.change({ note: this.note.value });
    return section("Note", this.note);
  }

  fileSection() {
    this.files = element("ul", { class: "map-files" });
    return section("Download", this.files,
      element("div", { class: "row" }, button("Delete this map", "trash", () => this.remove(), "danger")));
  }

  /** The map's frame, as a pose in the robot's world. */
  get frame() {
    const { x, y, theta } = this.map.frame;
    return [x, y, theta];
  }

  /** Open a map; `others` can be compared with it. */
  async open(map, others) {
    document.activeElement?.blur();
    this.box.hidden = false;
    this.plan.clear();
    this.choose(null);
    this.shares.textContent = "";
    this.picture.hidden = true;
    this.show(map);
    const choices = others.filter(({ id }) => id !== map.id).map(({ id, name }) => element("option", { value: String(id) }, name));
    this.other.replaceChildren(element("option", { value: "" }, choices.length ? "with no other map" : "there is no other map"), ...choices);
    this.other.disabled = !choices.length;
    this.back.focus({ preventScroll: true });
    await this.load();
  }

  async load() {
    const { id, revision } = this.map;
    this.stage.dataset.empty = "loading the map …";
    await this.attempt(async () => {
      const content = await ask(`maps/${id}/map.json`);
      if (this.map.id !== id) return;
      if (this.map.revision !== revision) return this.load(); // it was turned meanwhile
      delete this.stage.dataset.empty;
      this.plan.take(content, this.frame);
      this.show(this.map);
    });
  }

  close() {
    this.box.hidden = true;
    this.onClose();
  }

  /** Take over what REST says of the map. */
  show(map) {
    this.map = map;
    fill(this.name, map.name);
    fill(this.note, map.note);
    const size = `${map.width_m.toFixed(1)} × ${map.height_m.toFixed(1)} m`;
    this.figures.textContent = `${map.path_length_m.toFixed(1)} m driven, ${map.vertices} vertices, ${size}`;
    fill(this.turned, String(Math.round(-10 * map.frame.theta / DEGREE) / 10 || 0));
    this.plan.turn(this.frame, map.labels);
    this.canvas.setAttribute("aria-label", `Map ${map.name}, ${size}. Arrow keys move it, plus and minus zoom.`);
    this.labels.replaceChildren(...map.labels.map((label) => this.labelEntry(label)));
    this.files.replaceChildren(...Object.entries(FORMATS).map(([format, what]) => element("li", {},
      element("a", { href: `/api/v1/maps/${map.id}/map.${format}`, download: "" }, format.toUpperCase()), element("span", {}, what))));
    this.explain();
  }

  labelEntry(label) {
    const { id, text, x, y } = label;
    const away = element("button", { type: "button", class: "quiet", "aria-label": `Remove ${text}` }, icon("trash"));
    away.onclick = () => this.change(({ labels }) => ({ labels: labels.filter((one) => one.id !== id) }), `“${text}” removed`);
    return element("li", {}, element("b", {}, text), element("span", {}, `${x.toFixed(1)}, ${y.toFixed(1)} m`), away);
  }

  explain() {
    const marks = this.plan.other
      ? [["settled", this.map.name], ["open", this.other.selectedOptions[0].textContent]]
      : [["wall", "wall"], ["settled", "path, settled"], ["open", "path, open"]];
    this.legend.replaceChildren(...marks.map(([mark, text]) => element("li", {}, element("i", { class: `line ${mark}` }), text)));
  }

  /** Choose a place on the map for a tool, or for none. */
  choose(tool) {
    this.tool = this.tool === tool ? null : tool;
    this.plan.choose(this.tool !== null);
    this.prompt.hidden = this.tool === null;
    this.prompt.textContent = PROMPTS[this.tool] ?? "";
    this.form.hidden = true;
    for (const [name, one] of [["origin", this.origin], ["label", this.label]]) one.setAttribute("aria-pressed", String(this.tool === name));
    if (this.tool) this.canvas.focus();
  }

  place(place) {
    const { tool } = this;
    this.choose(null);
    if (tool === "origin") this.setFrame(({ frame: { x, y, theta } }) => compose([x, y, theta], [...place, 0]), "Origin set");
    if (tool !== "label") return;
    this.chosen = place;
    this.form.hidden = false;
    this.text.value = "";
    this.text.focus();
  }

  async addLabel(text) {
    const [x, y] = this.chosen;
    this.form.hidden = true;
    await this.change(({ labels }) => ({ labels: [...labels, { text, x, y }] }));
    this.label.focus();
  }

  /** Turn the axes to an angle that follows from what the map is then. */
  turn(angle, said) {
    return this.setFrame((map) => [map.frame.x, map.frame.y, wrap(angle(map))], said);
  }

  async setFrame(frame, said) {
    await this.change((map) => {
      const [x, y, theta] = frame(map);
      return { frame: { x, y, theta } };
    }, said);
    this.plan.fit();
  }

  /** Save a change `of` what the map is once those under way are saved; with words to say it can be taken back. */
  change(of, said = "") {
    const { id } = this.map;
    this.saving = this.saving.then(() => this.attempt(async () => {
      if (this.map.id !== id) return;
      const what = typeof of === "function" ? of(this.map) : of;
      const before = Object.fromEntries(Object.keys(what).map((key) => [key, this.map[key]]));
      this.show(await ask(`maps/${id}`, { method: "PATCH", body: { ...what, revision: this.map.revision } }));
      if (said) toast(said, { label: "Undo", run: () => this.undo(id, before) });
    }));
    return this.saving;
  }

  async undo(id, before) {
    if (this.map.id !== id) return;
    await this.change(before);
    if (before.frame) this.plan.fit();
  }

  async compare() {
    const { id } = this.map;
    const other = this.other.value;
    this.picture.hidden = true;
    if (!other) {
      this.shares.textContent = "";
      this.plan.overlay(null);
      this.explain();
      return;
    }
    this.shares.textContent = "comparing …";
    const address = `maps/${id}/compare/${other}`;
    const isAligned = this.isAligned.checked;
    const query = `?align=${isAligned}`;
    await this.attempt(async () => {
      const [found, content] = await Promise.all([ask(address + query), ask(`maps/${other}/map.json`)]);
      if (this.map.id !== id || this.other.value !== other || this.isAligned.checked !== isAligned) return;
      this.plan.overlay(content, [found.x, found.y, found.theta]);
      this.shares.textContent = sharesText(found);
      this.picture.href = `/api/v1/${address}.png${query}`;
      this.picture.hidden = false;
      this.explain();
    });
  }

  async remove() {
    const { id, name } = this.map;
    await this.attempt(async () => {
      await ask(`maps/${id}`, { method: "DELETE" });
      this.close();
      toast(`“${name}” deleted`, { label: "Undo", run: () => ask(`maps/${id}/restore`, { method: "POST" }).then(() => this.onClose()) });
    });
  }

  /** Do what may be refused; where somebody else was faster, show what they made. */
  async attempt(work) {
    try {
      await work();
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
      if (error.status === 409) this.show(await ask(`maps/${this.map.id}`));
      else if (this.map) this.show(this.map);
    }
  }
}

/** Set a field's value, unless somebody is writing in it. */
function fill(field, value) {
  if (document.activeElement !== field) field.value = value;
}

function button(text, picture, run, className = "") {
  return element("button", { type: "button", className, onclick: run }, picture && icon(picture), text);
}

function section(title, ...content) {
  return element("section", { class: "card" }, element("h3", {}, title), ...content);
}

function sharesText({ first_share, second_share, median_distance_m, tolerance_m }) {
  if (first_share === null) return "One of them has no walls.";
  const percent = (share) => `${Math.round(100 * share)} %`;
  const near = median_distance_m === null ? "" : ` Where they agree they lie ${Math.round(100 * median_distance_m)} cm apart.`;
  return `Within ${Math.round(100 * tolerance_m)} cm, ${percent(first_share)} of this map's walls are in the other, and ` +
    `${percent(second_share)} of the other's in this one.${near}`;
}
