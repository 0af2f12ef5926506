// Driving: keys, the stick, and the ways out (gamepads: gamepad.js). Whatever moves the robot is repeated while it is
// held, and a zero is said once on every way out of holding it; the server stops the robot by itself when this page falls
// silent.

const REPEAT = 80; // ms between two words of the driver
const KEYS = {
  KeyW: [1, 0], ArrowUp: [1, 0], KeyS: [-1, 0], ArrowDown: [-1, 0],
  KeyA: [0, 1], ArrowLeft: [0, 1], KeyD: [0, -1], ArrowRight: [0, -1],
};
const STRAIGHT = 0.12; // share of a stick's way to the side that still means straight on
const BACKING = 0.6; // share of the limit when driving backwards
const COVERS = "dialog[open], #menu.open"; // while one of these lies over the panels, nobody here drives, but stops
const SLOWEST_FULL_TURN = 0.25; // m/s of speed limit at which the full turn rate is allowed

export class Driver {
  constructor(connection, stick) {
    this.connection = connection;
    this.stick = stick;
    this.knob = stick.querySelector("i");
    this.held = new Set();
    this.source = null; // "keys", "stick" or "gamepad" while something is held
    this.wish = [0, 0]; // forward and left, -1 to 1
    this.limit = 0.3; // m/s
    this.maxTurn = 1.5; // rad/s
    this.seen = 0; // session time of the newest picture
    this.goal = null; // number of the goal that this page holds
    this.goals = 0; // sent so far
    this.isShared = false; // whether the robot bends the wish off obstacles
    this.runsItself = false; // whether the robot's own program drives it, and nobody here
    setInterval(() => this.repeat(), REPEAT);
    this.listenToKeys();
    this.listenToStick();
    addEventListener("blur", () => this.letGo());
    addEventListener("pagehide", () => this.leave());
    document.addEventListener("visibilitychange", () => document.hidden && this.leave());
  }

  get isLocked() {
    return !this.connection.isLive || this.connection.isLocked;
  }

  get hasGoal() {
    return this.goal !== null;
  }

  /** Whether something lies over what is driven by. A goal goes on meanwhile: it was confirmed, and the page is looked at. */
  get isCovered() {
    return document.querySelector(COVERS) !== null;
  }

  /** Stand still, whoever drives. */
  stop() {
    this.letGo();
    this.goal = null;
    this.connection.stop();
  }

  /** Let the robot drive to a place in the world, as long as this page watches. */
  goTo([x, y]) {
    this.letGo();
    this.goal = ++this.goals;
    this.connection.send({ type: "goal", id: this.goal, x, y, speed: this.limit, seen: this.seen });
  }

  /** The server answered about a goal that it has not. What it says of an earlier one is none of the present one's. */
  endGoal(id) {
    if (id === this.goal) this.goal = null;
  }

  cancelGoal() {
    this.goal = null;
    this.connection.send({ type: "cancel" });
  }

  /** The page is no longer looked at. */
  leave() {
    this.letGo();
    if (this.hasGoal) this.cancelGoal();
  }

  repeat() {
    if (this.source && (this.isLocked || this.isCovered)) this.letGo();
    if (this.isLocked) return;
    if (this.source) {
      this.sendWish();
    } else if (this.hasGoal && !document.hidden) {
      this.connection.send({ type: "hold", id: this.goal, seen: this.seen });
    }
  }

  sendWish() {
    const [forward, left] = this.wish;
    const speed = this.limit * (forward < 0 ? BACKING * forward : forward);
    const turn = this.maxTurn * Math.min(1, this.limit / SLOWEST_FULL_TURN) * left;
    this.connection.send({ type: "drive", speed, turn, seen: this.seen, shared: this.isShared });
  }

  hold(source, forward, left) {
    if (this.isLocked || this.isCovered || this.runsItself) return;
    const [before, wish] = [this.wish, [clamp(forward), clamp(left)]];
    const isNews = this.source === null || (source === "keys" && String(wish) !== String(before)); // a stick: at the next turn
    this.source = source;
    this.wish = wish;
    this.goal = null;
    this.showKnob();
    if (isNews) this.sendWish();
  }

  letGo() {
    this.held.clear();
    if (this.source === null) return;
    this.source = null;
    this.wish = [0, 0];
    this.showKnob();
    this.sendWish();
  }

  showKnob() {
    const reach = 0.5 * this.stick.clientWidth - 27;
    this.knob.style.transform = `translate(${-this.wish[1] * reach}px, ${-this.wish[0] * reach}px)`;
    this.stick.classList.toggle("held", this.source === "stick");
  }

  listenToKeys() {
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
      if (event.code === "Enter" && isSwitch(event.target)) event.target.click(); // what the space bar cannot do here
      if (event.code === "Space" || event.code === "Escape") {
        event.preventDefault();
        if (!event.repeat) this.stop();
      } else if (KEYS[event.code] && !isAdjusting(event) && !this.isCovered) {
        event.preventDefault();
        this.held.add(event.code);
        this.driveByKeys();
      }
    });
    addEventListener("keyup", (event) => {
      if (event.code === "Space" && !isTyping(event.target)) event.preventDefault(); // a focused button is not pressed
      if (this.held.delete(event.code)) this.driveByKeys();
    });
  }

  driveByKeys() {
    if (!this.held.size) {
      if (this.source === "keys") this.letGo();
      return;
    }
    let [forward, left] = [0, 0];
    for (const key of this.held) [forward, left] = [forward + KEYS[key][0], left + KEYS[key][1]];
    this.hold("keys", forward, 0.7 * left);
  }

  listenToStick() {
    const stick = this.stick;
    const follow = (event) => {
      const box = stick.getBoundingClientRect();
      const reach = 0.5 * box.width - 27;
      const forward = (box.top + box.height / 2 - event.clientY) / reach;
      const left = (box.left + box.width / 2 - event.clientX) / reach;
      const length = Math.max(1, Math.hypot(forward, left));
      this.hold("stick", forward / length, straightened(left / length));
    };
    stick.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      stick.setPointerCapture(event.pointerId);
      follow(event);
    });
    stick.addEventListener("pointermove", (event) => this.source === "stick" && follow(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      stick.addEventListener(name, () => this.source === "stick" && this.letGo());
    }
    stick.addEventListener("contextmenu", (event) => event.preventDefault());
  }
}

function clamp(value) {
  return Math.max(-1, Math.min(1, value));
}

/** A thumb that pushes forward is never exactly straight. */
export function straightened(left) {
  return (Math.sign(left) * Math.max(0, Math.abs(left) - STRAIGHT)) / (1 - STRAIGHT);
}

function isTyping(target) {
  return target.matches?.("textarea, select, input:not([type=range], [type=checkbox])") || target.isContentEditable;
}

function isSwitch(target) {
  return target.matches?.("input[type=checkbox]");
}

/** Arrow keys on a focused slider belong to the slider. */
function isAdjusting(event) {
  return event.code.startsWith("Arrow") && event.target.matches?.("input[type=range]");
}
