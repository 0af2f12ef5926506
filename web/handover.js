// One drives, others ask: the request in front of the driver, the waiting of who asked, and what became of it.

import { toast } from "./toast.js";

export class Handover {
  /** `container` is filled with the request; `button` asks for control. */
  constructor(container, button, connection, driver) {
    this.container = container;
    this.button = button;
    this.connection = connection;
    this.driver = driver;
    this.before = null; // the driver's status as it was last
    this.words = document.createElement("p");
    this.words.setAttribute("role", "alert");
    this.time = document.createElement("span");
    this.time.setAttribute("aria-hidden", "true"); // read out once, not at every second
    this.give = this.answer("Hand over", () => {
      driver.letGo();
      connection.send({ type: "give", to: this.before.asked_by });
    });
    this.give.className = "primary";
    this.keep = this.answer("Keep", () => connection.send({ type: "keep" }));
    container.append(this.words, this.time, this.give, this.keep);
    button.onclick = () => connection.send({ type: "ask" });
  }

  answer(label, run) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    button.onclick = run;
    return button;
  }

  /** `who` is `status.driver`. */
  show(who) {
    const me = this.connection.viewer;
    const isMine = who.viewer === me;
    const isAsking = who.asked_by === me;
    this.tellChange(who, me);
    this.before = who;
    this.button.hidden = isMine || isAsking || who.viewer === null;
    this.container.hidden = !(who.asked_by !== null && (isMine || isAsking));
    if (this.container.hidden) return;
    this.say(isMine ? `${who.asked_by} asks to drive.` : `You asked ${who.viewer} for control.`);
    this.time.textContent = `${Math.ceil(who.answer_s)} s`;
    this.give.hidden = this.keep.hidden = !isMine;
  }

  say(text) {
    if (this.words.textContent !== text) this.words.textContent = text;
  }

  tellChange(who, me) {
    const { before } = this;
    if (before === null || me === null) return;
    const asked = before.asked_by === me && who.asked_by !== me;
    if (asked && who.viewer === me) toast("You drive now.", { level: "good" });
    else if (asked) toast(`${before.viewer} keeps control.`);
    else if (before.viewer === me && who.viewer !== null && who.viewer !== me) toast(`${who.viewer} drives now.`);
  }
}
