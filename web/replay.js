// Replay: the bar that plays a recording on this page. Space plays and pauses, the arrow keys go back and forth; STOP and
// Escape still stop the robot, which may be driving elsewhere meanwhile.

import { element } from "./elements.js";
import { icon } from "./icons.js";
import { ask } from "./rest.js";
import { clockTime } from "./times.js";
import { toast } from "./toast.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 100];
const STEP = 5; // s that an arrow key moves

/** The id of the recording that the page's address asks for; null on the live page. */
export function askedRecording() {
  return new URLSearchParams(location.search).get("recording");
}

/** Where the frames of a recording come from. */
export function streamOf(recording) {
  return `/api/v1/recordings/${encodeURIComponent(recording)}/stream`;
}

export class Replay {
  constructor(bar, connection, recording) {
    this.connection = connection;
    this.recording = recording;
    this.state = null; // the newest frame of topic `replay`
    this.isHeld = false; // whether somebody moves the slider
    document.body.classList.add("replaying");
    this.build(bar);
    connection.addEventListener("replay", ({ detail }) => this.show(detail.header));
    addEventListener("keydown", (event) => this.press(event), { capture: true });
    addEventListener("keyup", (event) => event.code === "Space" && !isTyping(event.target) && event.preventDefault(), { capture: true });
  }

  build(bar) {
    this.title = element("b", {}, this.recording);
    this.button = element("button", { type: "button", class: "primary", onclick: () => this.toggle() }, icon("play"));
    this.slider = element("input", { type: "range", min: 0, max: 1, step: 0.1, value: 0, "aria-label": "Time" });
    this.slider.oninput = () => this.seek(Number(this.slider.value));
    this.slider.onpointerdown = () => (this.isHeld = true);
    this.slider.onpointerup = this.slider.onpointercancel = () => (this.isHeld = false);
    this.time = element("output", {}, "0:00");
    this.speed = element("select", { "aria-label": "Speed" }, ...SPEEDS.map((factor) => element("option", { value: factor }, factor === 100 ? "max" : `${factor} ×`)));
    this.speed.value = 1;
    this.speed.onchange = () => this.send({ type: "speed", factor: Number(this.speed.value) });
    this.note = element("p", { class: "note", role: "status" });
    this.keep = element("button", { type: "button", onclick: () => this.keepMap() }, icon("save"), "Keep map");
    bar.append(
      element("p", { class: "title" }, "Replay ", this.title),
      this.button,
      this.slider,
      this.time,
      this.speed,
      this.keep,
      element("a", { class: "button", href: "/" }, "Live"),
      this.note,
    );
    bar.hidden = false;
    this.label(true);
  }

  /** People's name for the recording, where it has one. */
  async name() {
    const { name } = await ask(`recordings/${encodeURIComponent(this.recording)}`).catch(() => ({ name: "" }));
    if (name) this.title.textContent = name;
  }

  show(state) {
    if (!this.state) this.name();
    this.state = state;
    this.label(state.playing);
    this.slider.max = Math.max(state.duration, 0.1);
    if (!this.isHeld) this.slider.value = state.t;
    this.slider.style.setProperty("--rendered", `${(100 * state.rendered) / Math.max(state.duration, 0.1)}%`);
    this.slider.setAttribute("aria-valuetext", `${clockTime(state.t)} of ${clockTime(state.duration)}`);
    this.time.textContent = `${clockTime(state.t)} / ${clockTime(state.duration)}`;
    if (document.activeElement !== this.speed) this.speed.value = state.speed;
    const text = [progressText(state), state.note].filter(Boolean).join(" ");
    if (this.note.textContent !== text) this.note.textContent = text;
  }

  label(isPlaying) {
    if (this.button.dataset.playing === String(isPlaying)) return;
    this.button.dataset.playing = String(isPlaying);
    this.button.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.button.title = isPlaying ? "Pause: Space (Escape stops the robot)" : "Play: Space (Escape stops the robot)";
    this.button.replaceChildren(icon(isPlaying ? "pause" : "play"));
  }

  toggle() {
    if (this.state) this.send({ type: this.state.playing ? "pause" : "play" });
  }

  seek(t) {
    this.send({ type: "seek", t: Math.max(0, Math.min(t, this.state?.duration ?? 0)) });
  }

  send(word) {
    this.connection.send(word);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const isOnSlider = event.target === this.slider;
    if (event.code === "Space") {
      this.take(event);
      if (!event.repeat) this.toggle();
    } else if ((event.code === "ArrowLeft" || event.code === "ArrowRight") && (isOnSlider || !event.target.closest?.("[role=tablist], input"))) {
      this.take(event);
      this.seek((this.state?.t ?? 0) + (event.code === "ArrowLeft" ? -STEP : STEP));
    }
  }

  /** The key is meant for the replay, and for nothing else. */
  take(event) {
    event.preventDefault();
    event.stopPropagation();
  }

  async keepMap() {
    this.keep.disabled = true;
    toast("Mapping the whole recording …");
    try {
      const map = await ask(`recordings/${encodeURIComponent(this.recording)}/maps`, { method: "POST", body: {} });
      toast(`Kept as map "${map.name}"`, { level: "good" });
    } catch (error) {
      toast(`The map was not kept: ${error.message}`, { level: "bad" });
    }
    this.keep.disabled = false;
  }
}

function progressText({ state, rendered, duration }) {
  if (state === "waiting") return "Waits until another recording is prepared.";
  if (state !== "rendering") return "";
  return duration ? `Preparing: ${Math.floor((100 * rendered) / duration)} %` : "Preparing …";
}

function isTyping(target) {
  return target.matches?.("textarea, select, input:not([type=range])") || target.isContentEditable;
}
