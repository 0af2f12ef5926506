// The library's first pane: the session that runs, and the recordings of all that ran.

import { element } from "./elements.js";
import { icon } from "./icons.js";
import { ask, sentence } from "./rest.js";
import { clockTime, dateTime, fileSize } from "./times.js";
import { toast } from "./toast.js";

const REFRESH = 5000; // ms between two looks while the pane is in sight
const SURE = 4000; // ms in which a second press ends the session

export class Recordings {
  constructor(pane, connection) {
    this.pane = pane;
    this.session = element("section", { class: "card session", "aria-label": "Session" });
    this.list = element("section", { class: "recordings", "aria-label": "Recordings" });
    this.facts = element("p", { class: "note" });
    this.shown = {}; // what was made of what
    this.asked = 0; // times that the server was asked; only the newest answer counts
    this.timer = 0;
    pane.append(this.session, element("h2", {}, "Recordings"), this.list);
    pane.addEventListener("show", () => this.start());
    pane.addEventListener("hide", () => clearInterval(this.timer));
    connection.addEventListener("notice", ({ detail }) => detail.header.kind === "begin" && this.timer && this.refresh());
  }

  start() {
    clearInterval(this.timer);
    this.timer = setInterval(() => this.refresh(), REFRESH);
    this.refresh();
  }

  /** Ask the server; what somebody is typing is left alone. */
  async refresh() {
    const turn = ++this.asked;
    try {
      const [session, recordings] = await Promise.all([ask("sessions/current"), ask("recordings")]);
      if (turn !== this.asked) return;
      this.facts.textContent = factsOf(session);
      this.renew("session", [session.number, session.name, session.running], () => this.showSession(session));
      this.renew("list", recordings.map((one) => ({ ...one, ...(one.running && { size: 0, duration_s: 0 }) })), () => this.showList(recordings));
    } catch (error) {
      if (turn !== this.asked) return;
      this.shown = {};
      const again = element("button", { type: "button", onclick: () => this.refresh() }, "Try again");
      this.list.replaceChildren(element("p", { class: "empty" }, `The recordings cannot be listed: ${error.message}. `, again));
    }
  }

  /** Make a part anew if what it shows has changed and nobody types in it. */
  renew(part, content, make) {
    const text = JSON.stringify(content);
    if (this.shown[part] === text || this[part].querySelector("input:focus")) return;
    this.shown[part] = text;
    make();
  }

  /** Do something, say what came of it, and look again. */
  async act(call, done) {
    try {
      const answer = await call();
      if (done) toast(done, { level: "good" });
      this.shown = {};
      await this.refresh();
      return answer;
    } catch (error) {
      toast(sentence(error.message), { level: "bad" });
      return null;
    }
  }

  // The session.

  showSession(session) {
    const title = session.running ? session.name || "Session without a name" : "No session runs";
    this.session.replaceChildren(
      element("h2", {}, title),
      this.facts,
      ...(session.running ? [this.nameForm(session)] : []),
      this.beginForm(session),
    );
  }

  nameForm(session) {
    const name = element("input", { name: "name", value: session.name, maxLength: 80, placeholder: "Name", "aria-label": "Name of the session" });
    const end = element("button", { type: "button", class: "danger" }, "End session");
    end.onclick = () => this.end(end);
    const form = element("form", { class: "row" }, name, element("button", { type: "submit" }, icon("edit"), "Name it"), end);
    form.onsubmit = (event) => {
      event.preventDefault();
      name.blur();
      this.act(() => ask("sessions/current", { method: "PATCH", body: { name: name.value } }), "Session named");
    };
    return form;
  }

  /** The first press asks, the second ends. */
  end(button) {
    if (!button.dataset.asked) {
      button.dataset.asked = "yes";
      button.textContent = "Press again to end";
      setTimeout(() => {
        delete button.dataset.asked;
        button.textContent = "End session";
      }, SURE);
      return;
    }
    button.disabled = true;
    this.act(async () => {
      const ended = await ask("sessions/current/end", { method: "POST" });
      if (ended.map_error) return toast(notKept(ended), { label: "Close", level: "bad" });
      return toast(ended.map ? "Session ended; its map is among the maps" : "Session ended", { level: "good" });
    });
  }

  beginForm(session) {
    const name = element("input", { name: "name", maxLength: 80, placeholder: "Name (optional)", "aria-label": "Name of the new session" });
    const particles = element("input", { name: "particles", type: "number", min: 1, max: 100_000, placeholder: "as set", "aria-label": "Particles" });
    const form = element("form", { class: "row" }, name,
      element("label", { class: "inline" }, "Particles ", particles),
      element("button", { type: "submit", class: session.running ? "" : "primary" }, "Begin a session"));
    form.onsubmit = async (event) => {
      event.preventDefault();
      const settings = particles.value ? { "crunch.filter.particles": Number(particles.value) } : {};
      document.activeElement?.blur();
      const begun = await this.act(() => ask("sessions", { method: "POST", body: { name: name.value, settings } }), "A new session has begun");
      if (begun && session.running) this.checkMap(session.number);
    };
    if (!session.running) return form;
    return element("details", {}, element("summary", {}, "New session"), element("p", { class: "note" }, "The session that runs is ended first, and its map is kept."), form);
  }

  /** Whether the map of a session that another one has ended was kept. */
  async checkMap(number) {
    const ended = (await ask("sessions").catch(() => [])).find((one) => one.number === number);
    if (ended?.map_error) toast(notKept(ended), { label: "Close", level: "bad" });
  }

  // The recordings.

  showList(recordings) {
    if (!recordings.length) {
      this.list.replaceChildren(element("p", { class: "empty" }, "No recordings yet. Every session is recorded here by itself."));
      return;
    }
    this.list.replaceChildren(element("ul", {}, ...recordings.map((one) => this.line(one))));
  }

  line(recording) {
    const name = recording.name || recording.id;
    const facts = [dateTime(recording.began), clockTime(recording.duration_s), fileSize(recording.size), recording.robot];
    const line = element("li", { class: "card", "data-id": recording.id },
      element("div", { class: "about" },
        element("h3", {}, name, ...badges(recording)),
        element("p", { class: "note" }, recording.error || facts.filter(Boolean).join(" · "))),
      element("div", { class: "row" },
        recording.error ? null : element("a", { class: "button primary", href: `/?recording=${encodeURIComponent(recording.id)}`, "aria-label": `Replay ${name}` }, icon("play"), "Replay"),
        element("a", { class: "button", href: `/api/v1/recordings/${encodeURIComponent(recording.id)}/file`, download: "", "aria-label": `Download ${name}` }, icon("download"), "File"),
        recording.error ? null : this.tool("save", "Keep map", `Keep the map of ${name}`, (button) => this.keepMap(recording, button)),
        recording.running ? null : this.tool("edit", "Rename", `Rename ${name}`, () => this.rename(recording, line)),
        recording.running ? null : this.tool("trash", "Delete", `Delete ${name}`, () => this.remove(recording))));
    return line;
  }

  tool(picture, text, label, run) {
    const button = element("button", { type: "button", "aria-label": label }, icon(picture), text);
    button.onclick = () => run(button);
    return button;
  }

  rename(recording, line) {
    const name = element("input", { value: recording.name, maxLength: 80, placeholder: "Name", "aria-label": "Name of the recording" });
    const form = element("form", { class: "row" }, name, element("button", { type: "submit", class: "primary" }, "Save"));
    form.onsubmit = (event) => {
      event.preventDefault();
      name.blur();
      this.act(() => ask(path(recording), { method: "PATCH", body: { name: name.value } }));
    };
    line.querySelector(".about").replaceChildren(form);
    name.focus();
    name.select();
  }

  async keepMap(recording, button) {
    button.disabled = true;
    toast("Mapping the recording …");
    const map = await this.act(() => ask(`${path(recording)}/maps`, { method: "POST", body: {} }));
    button.disabled = false;
    if (map) toast(`Kept as map "${map.name}"`, { level: "good" });
  }

  async remove(recording) {
    const isGone = await this.act(async () => (await ask(path(recording), { method: "DELETE" })) ?? true);
    const restore = () => this.act(() => ask(`${path(recording)}/restore`, { method: "POST" }));
    if (isGone) toast(`${recording.name || recording.id} deleted`, { label: "Undo", run: restore });
  }
}

/** Why the map of an ended session is missing, and what to do. */
function notKept({ map_error: reason }) {
  return `The map was not kept: ${reason}. When that is mended, press Keep map beside its recording.`;
}

function factsOf(session) {
  const { running, began, vertices, path_length_m: metres, recording } = session;
  if (!running) {
    const lost = session.map_error ? ` ${notKept(session)}` : "";
    return `Nobody can drive, and nothing is recorded or mapped, until a session begins.${lost}`;
  }
  const facts = [`since ${dateTime(began)}`, `${vertices} ${vertices === 1 ? "vertex" : "vertices"}`, `${metres.toFixed(1)} m`];
  return [...facts, ...(recording ? [] : ["not recorded"])].join(" · ");
}

function path(recording) {
  return `recordings/${encodeURIComponent(recording.id)}`;
}

function badges({ running, truncated, damaged }) {
  const words = [running && "recording now", truncated && !running && "cut", damaged > 0 && "damaged"].filter(Boolean);
  return words.map((word) => element("span", { class: "badge" }, word));
}
