// Help where it is needed: the welcome card, and behind each panel's question mark what the panel shows.

const LEARNT = 2500; // ms of driving after which the welcome is no longer needed

export class Help {
  constructor(card, button) {
    this.card = card;
    this.button = button;
    this.driven = 0; // ms that the person has driven on this page
    button.onclick = () => this.welcome(card.hidden);
    card.querySelector("#hint-close").onclick = () => this.welcome(false);
    this.welcome(localStorage.getItem("welcomed") !== "yes");
    for (const note of document.querySelectorAll(".explain")) addQuestionMark(note);
  }

  /** Show or put away the welcome card; who has put it away once is not welcomed again. */
  welcome(isShown) {
    if (!isShown && this.card.contains(document.activeElement)) this.button.focus();
    this.card.hidden = !isShown;
    this.button.setAttribute("aria-expanded", String(isShown));
    document.body.classList.toggle("new", isShown);
    if (!isShown) localStorage.setItem("welcomed", "yes");
  }

  /** The person has been driving for `time` ms more. */
  seeDriving(time) {
    if (this.card.hidden) return;
    this.driven += time;
    if (this.driven >= LEARNT) this.welcome(false);
  }
}

function addQuestionMark(note) {
  const head = note.closest(".panel").querySelector(".head");
  const title = head.querySelector("h2");
  const button = document.createElement("button");
  button.type = "button";
  button.className = "why";
  button.textContent = "?";
  button.setAttribute("aria-label", `What does ${title.textContent} show?`);
  button.setAttribute("aria-controls", note.id);
  const show = (isShown) => {
    note.hidden = !isShown;
    button.setAttribute("aria-expanded", String(isShown));
  };
  button.onclick = () => show(note.hidden);
  document.addEventListener("pointerdown", ({ target }) => {
    if (!note.contains(target) && target !== button) show(false);
  });
  show(false);
  title.after(button);
}
