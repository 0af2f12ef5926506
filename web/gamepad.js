// Gamepads: a pad drives while its right shoulder button is held, a dead man's button. A pad that is pulled out, turns
// into another one or freezes with its stick pushed lets go.

import { straightened } from "./drive.js";

const HOLD = 5; // RB or R1 of the standard layout
const STOP = 1; // B or circle
const DEAD_ZONE = 0.12; // of the stick's way
const FROZEN = 2000; // ms without news from a pad whose stick is pushed

export class Gamepads {
  constructor(driver, line) {
    this.driver = driver;
    this.line = line;
    this.known = new Map(); // what was seen of each pad, by index and name
    this.driving = null; // the pad that drives now
    this.isLooking = false;
    addEventListener("gamepadconnected", () => this.start());
    addEventListener("gamepaddisconnected", () => this.look());
    if (pads().length) this.start();
  }

  start() {
    if (this.isLooking) return;
    this.isLooking = true;
    const turn = () => {
      this.look();
      if (pads().length) requestAnimationFrame(turn);
      else this.isLooking = false;
    };
    turn();
  }

  look() {
    const now = performance.now();
    const present = pads();
    const seen = new Map(present.map((pad) => [keyOf(pad), this.observe(pad, now)]));
    this.known = seen;
    if (this.driving !== null && !seen.get(this.driving)?.mayDrive) this.letGo();
    for (const [key, pad] of seen) {
      if (pad.pressesStop) this.driver.stop();
      else if (pad.mayDrive && (this.driving === key || (this.driving === null && pad.isPushed))) this.drive(key, pad);
    }
    this.tell([...seen.entries()]);
  }

  /** What a pad does now. A button counts only once it has been seen up, so that a stuck one does nothing, nor
   * one that was held while something lay over the page. */
  observe(pad, now) {
    const before = this.known.get(keyOf(pad)) ?? { timestamp: null, changed: now, holdWasUp: false, stopWasUp: false };
    const changed = pad.timestamp === before.timestamp ? before.changed : now;
    const isHeld = pad.buttons[HOLD]?.pressed ?? false;
    const isStopped = pad.buttons[STOP]?.pressed ?? false;
    const [forward, left] = stickOf(pad);
    const isPushed = forward !== 0 || left !== 0;
    const isFrozen = isHeld && isPushed && now - changed > FROZEN;
    const holdWasUp = !isHeld || (before.holdWasUp && !this.driver.isCovered);
    return {
      name: nameOf(pad), timestamp: pad.timestamp, changed, forward, left, isPushed, isFrozen, holdWasUp,
      stopWasUp: !isStopped,
      pressesStop: isStopped && before.stopWasUp,
      mayDrive: isHeld && holdWasUp && !isFrozen && document.hasFocus(),
    };
  }

  drive(key, { forward, left }) {
    this.driving = key;
    this.driver.hold("gamepad", forward, left);
  }

  letGo() {
    this.driving = null;
    if (this.driver.source === "gamepad") this.driver.letGo();
  }

  tell(entries) {
    const [, pad] = entries.find(([key]) => key === this.driving) ?? entries.find(([, { isFrozen }]) => isFrozen) ?? entries[0] ?? [];
    const text = !pad ? ""
      : pad.isFrozen ? `${pad.name} sends nothing new: move its stick`
      : this.driving !== null ? `${pad.name} drives`
      : `${pad.name}: hold RB to drive, B stops`;
    this.line.hidden = text === "";
    if (this.line.textContent !== text) this.line.textContent = text;
  }
}

function pads() {
  return [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected);
}

function keyOf(pad) {
  return `${pad.index} ${pad.id}`;
}

/** Without the maker's numbers that browsers put behind it. */
function nameOf(pad) {
  return pad.id.replace(/\s*\(.*$/, "").replace(/^[0-9a-f]{4}-[0-9a-f]{4}-/i, "") || "Gamepad";
}

/** Forward and left, each -1 to 1. */
function stickOf({ axes: [x = 0, y = 0] }) {
  const length = Math.hypot(x, y);
  if (length < DEAD_ZONE) return [0, 0];
  const scale = Math.min(1, (length - DEAD_ZONE) / (1 - DEAD_ZONE)) / length;
  return [-y * scale, straightened(-x * scale)];
}
