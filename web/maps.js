// The library's maps: saved ones as cards, the deleted ones too, and one of them opened.

import { element } from "./elements.js";
import { icon } from "./icons.js";
import { MapSheet } from "./map_sheet.js";
import { ask, sentence } from "./rest.js";
import { toast } from "./toast.js";

const DATE = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

export class MapsPane {
  /** In a replay (`isLive` false) there is no present map to be saved. */
  constructor(box, isLive = true) {
    this.maps = [];
    this.asked = 0; // times that the server was asked; only the newest answer counts
    this.opener = null; // number of the map whose card is to be focused again
    this.name = element("input", { type: "text", maxLength: 120, "aria-label": "Name for the map", placeholder: "Name, if you like" });
    this.form = element("form", { class: "row", hidden: !isLive }, this.name, element("button", { type: "submit", class: "primary" }, icon("save"), "Save the present map"));
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.save(this.name.value);
    };
    this.deleted = element("button", { type: "button", "aria-pressed": "false", onclick: () => this.switchDeleted() }, icon("trash"), "Deleted maps");
    this.cards = element("ul", { class: "map-cards" });
    this.word = element("p", { class: "empty", role: "status" });
    this.list = element("div", {}, element("div", { class: "map-bar" }, this.form, this.deleted), this.cards, this.word);
    const sheet = element("div", { class: "map-sheet", hidden: true });
    this.sheet = new MapSheet(sheet, () => this.back());
    box.replaceChildren(this.list, sheet);
    this.isShown = false;
    box.addEventListener("hide", () => (this.isShown = false));
    box.addEventListener("show", () => {
      this.isShown = true;
      this.load();
    });
  }

  get showsDeleted() {
    return this.deleted.getAttribute("aria-pressed") === "true";
  }

  switchDeleted() {
    this.deleted.setAttribute("aria-pressed", String(!this.showsDeleted));
    this.load();
  }

  async load() {
    const turn = ++this.asked;
    if (!this.cards.childElementCount) this.say("loading …");
    try {
      const maps = await ask(`maps?deleted=${this.showsDeleted}`);
      if (turn !== this.asked) return;
      this.maps = maps;
    } catch (error) {
      if (turn === this.asked) this.say(error.message, element("button", { type: "button", onclick: () => this.load() }, "Try again"));
      return;
    }
    this.cards.replaceChildren(...this.maps.map((map) => this.card(map)));
    this.say(this.maps.length ? "" : this.showsDeleted ? "Nothing was deleted."
      : "No map is saved yet. Save the present one here; when a session ends, its map is kept by itself.");
    if (this.opener !== null) this.cards.querySelector(`[data-map="${this.opener}"] button`)?.focus();
    this.opener = null;
  }

  say(text, ...further) {
    this.word.hidden = text === "";
    this.word.replaceChildren(text, " ", ...further);
  }

  card(map) {
    const { id, name, saved, path_length_m, width_m, height_m, revision, is_deleted } = map;
    const picture = element("img", { src: `/api/v1/maps/${id}/thumbnail.png?${revision}`, alt: "", width: 480, height: 320, loading: "lazy" });
    const title = element("button", { type: "button", class: "map-title", onclick: () => this.open(map) }, name);
    const facts = `${DATE.format(new Date(1000 * saved))} · ${path_length_m.toFixed(1)} m · ${width_m.toFixed(1)} × ${height_m.toFixed(1)} m`;
    const action = is_deleted
      ? element("button", { type: "button", onclick: () => this.restore(map) }, "Take back")
      : element("button", { type: "button", class: "quiet danger", "aria-label": `Delete ${name}`, onclick: () => this.remove(map) }, icon("trash"));
    if (is_deleted) title.disabled = true;
    return element("li", { class: "card", "data-map": String(id) }, picture, element("div", {}, title, action), element("p", { class: "note" }, facts));
  }

  open(map) {
    this.list.hidden = true;
    this.opener = map.id;
    this.sheet.open(map, this.maps);
  }

  back() {
    if (this.sheet.box.hidden) this.list.hidden = false;
    return this.load();
  }

  /** Save the present map; what was saved, or null. */
  async save(name = "") {
    try {
      const map = await ask("maps", { method: "POST", body: { name } });
      this.name.value = "";
      toast(`Saved as “${map.name}”`, { level: "good" });
      if (this.showsDeleted) this.switchDeleted();
      else if (this.isShown) await this.load();
      return map;
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
      return null;
    }
  }

  async remove(map) {
    if (await this.attempt(`maps/${map.id}`, "DELETE")) {
      toast(`“${map.name}” deleted`, { label: "Undo", run: () => this.restore(map) });
    }
  }

  async restore(map) {
    if (await this.attempt(`maps/${map.id}/restore`, "POST")) toast(`“${map.name}” is back`, { level: "good" });
  }

  async attempt(address, method) {
    try {
      await ask(address, { method });
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
      return false;
    }
    await this.load();
    return true;
  }
}
