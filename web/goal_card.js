// Where to go: a click proposes a place, a button confirms it. A place may also be proposed by another view.

export class GoalCard {
  constructor(card, map, driver) {
    this.card = card;
    this.map = map;
    this.driver = driver;
    card.querySelector("#goal-go").onclick = () => this.go();
    card.querySelector("#goal-cancel").onclick = () => this.drop();
    card.addEventListener("keydown", ({ code }) => code === "Escape" && this.drop());
  }

  /** Ask whether to drive to [x, y] in the world. */
  propose([x, y]) {
    this.map.propose([x, y]);
    this.card.querySelector("#goal-place").textContent = `${x.toFixed(1)}, ${y.toFixed(1)} m`;
    this.card.hidden = false;
    this.card.querySelector("#goal-go").focus({ preventScroll: true });
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
