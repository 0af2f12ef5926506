// The map panel's layers: each is one function that draws a topic's newest frame (docs/http.md says how to add one), with
// a switch that is remembered.

const layers = new Map();
const changed = new EventTarget();

/**
 * Draw topic `name` on the map.
 *
 * `draw(context, view, frame)` draws in world metres, y up; `view.pixel` is the size of a pixel there, `view.frames` has
 * every topic's newest frame. It is called once there is a frame of `topic` (its name, if not given; null: always), lower
 * `z` first. What `isStill` changes with its frames only: it is drawn into a picture that follows the map. Without a
 * `label` there is no switch. `suits(has)` tells whether it is of a robot, where `has(topic)` tells which topics that has.
 */
export function layer(name, { label = "", z = 30, isOn = true, isStill = false, topic = name, suits = () => true, draw }) {
  const stored = label ? localStorage.getItem(`layer.${name}`) : null;
  layers.set(name, { name, label, z, isStill, topic, suits, draw, isOn: stored === null ? isOn : stored === "on" });
  changed.dispatchEvent(new Event("change"));
}

/** All layers, the lowest first. */
export function inOrder() {
  return [...layers.values()].sort((one, other) => one.z - other.z);
}

/** Be called when a layer comes, or is switched. */
export function onLayers(listener) {
  changed.addEventListener("change", listener);
}

export function switchLayer(name, isOn) {
  layers.get(name).isOn = isOn;
  localStorage.setItem(`layer.${name}`, isOn ? "on" : "off");
  changed.dispatchEvent(new Event("change"));
}

/** The switches, and the button that shows them; layers of topics that the robot has not are left out. */
export class Switches {
  constructor(box, button) {
    this.box = box;
    this.button = button;
    this.topics = null; // that the robot has; null while it is not known
    button.onclick = () => this.open(box.hidden);
    box.addEventListener("keydown", ({ code }) => {
      if (code !== "Escape") return;
      this.open(false);
      button.focus();
    });
    document.addEventListener("pointerdown", ({ target }) => {
      if (!box.hidden && !box.contains(target) && !button.contains(target)) this.open(false);
    });
    onLayers(() => this.fill());
    this.fill();
  }

  open(isOpen) {
    this.box.hidden = !isOpen;
    this.button.setAttribute("aria-expanded", String(isOpen));
  }

  /** Take over `status.robot.layers`. */
  offer(topics) {
    if (String(topics) === String(this.topics)) return;
    this.topics = topics;
    this.fill();
  }

  fill() {
    const has = (topic) => this.topics.includes(topic);
    const isOffered = ({ label, topic, suits }) => label && (!this.topics || ((topic === null || has(topic)) && suits(has)));
    const known = new Map([...this.box.children].map((button) => [button.dataset.layer, button]));
    const wanted = inOrder().filter(isOffered).reverse().map((one) => {
      const button = known.get(one.name) ?? makeSwitch(one);
      button.setAttribute("aria-checked", String(one.isOn));
      return button;
    });
    if (String(wanted.map(({ dataset }) => dataset.layer)) !== String([...known.keys()])) this.box.replaceChildren(...wanted);
  }
}

/** A button rather than a box to tick: Enter switches, and the space bar stops the robot as everywhere else. */
function makeSwitch({ name, label }) {
  const button = document.createElement("button");
  button.type = "button";
  button.role = "switch";
  button.dataset.layer = name;
  button.textContent = label;
  button.onclick = () => switchLayer(name, !layers.get(name).isOn);
  return button;
}
