// A robot that its own program drives: its run in figures in place of a stick, and in words where on a given map it may be.

import { element } from "./elements.js";

const DOING = { drive: "drives", back: "backs up", turn: "turns" };

export class RunCard {
  /** `figures` is a list of terms, `words` the line over the map. */
  constructor(figures, words) {
    this.words = words;
    const values = ["Run", "Bumps", "Stages lost", "Battery"].map((name) => {
      const value = element("dd", {}, "–");
      figures.append(element("div", {}, element("dt", {}, name), value));
      return value;
    });
    [this.number, this.bumps, this.lost, this.battery] = values;
  }

  /** Take over `status.robot`. */
  show({ run, whereabouts, battery_volts: volts }) {
    say(this.number, run?.number ? String(run.number) : "–");
    say(this.bumps, run ? String(run.bumps) : "–");
    say(this.lost, run ? `${run.lost_stages} of ${run.stages}` : "–");
    this.lost.dataset.level = run?.lost_stages ? "warn" : "";
    say(this.battery, volts === null ? "–" : `${volts.toFixed(1)} V`);
    this.words.hidden = !whereabouts;
    if (!whereabouts) return;
    say(this.words, whereabouts.words);
    this.words.dataset.state = whereabouts.localized ? "found" : "open";
  }
}

function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** What it does now. */
export function runText({ state, run }) {
  if (!run) return "not heard yet";
  return state === "armed" ? `runs by itself: ${DOING[run.doing] ?? "begins"}` : "stands";
}
