// Where to go: a click proposes a place, a button confirms it. A place that came from elsewhere, the view in three
// dimensions, never takes the place of what somebody decides about here, nor the focus from what they do.

import { toast } from "./toast.js";

export class GoalCard {
  constructor(card, map, driver) {
    this.card = card;
    this.map = map;
    this.driver = driver;
    this.withdraw = () => {}; // the message about a place that waits
    card.querySelector("#goal-go").onclick = () => this.go();
    card.querySelector("#goal-cancel").onclick = () => this.drop();
    card.addEventListener("keydown", ({ code }) => code === "Escape" && this.drop());
  }

  /** Ask whether to drive to [x, y] in the world. */
  propose(place) {
    this.show(place);
    const [go, cancel] = ["#goal-go", "#goal-cancel"].map((name) => this.card.querySelector(name));
    (go.checkVisibility() ? go : cancel).focus({ preventScroll: true });
  }

  /** A place [x, y] came from elsewhere. While a card is open it waits in a message, whose button calls `show`. */
  hear(place, show) {
    this.withdraw();
    if (this.card.hidden) show();
    else this.withdraw = toast(`Another place was proposed: ${inWords(place)}.`, { label: "Show", run: show });
  }

  show(place) {
    this.map.propose(place);
    this.card.querySelector("#goal-place").textContent = inWords(place);
    this.card.hidden = false;
  }

  go() {
    this.driver.goTo(this.map.candidate);
    this.drop();
  }

  drop() {
    const hadFocus = this.card.contains(document.activeElement);
    this.map.propose(null);
    this.card.hidden = true;
    if (hadFocus) this.map.canvas.focus({ preventScroll: true });
  }
}

function inWords([x, y]) {
  return `${x.toFixed(1)}, ${y.toFixed(1)} m`;
}
