// The library: a sheet below the header with one tab for each pane. It covers the panels but never the STOP button.
//
// A pane is told by the events `show` and `hide` when it comes into sight and leaves it, so that it asks the server for
// nothing while nobody looks.

export class Library {
  constructor(sheet) {
    this.sheet = sheet;
    this.tabs = [...sheet.querySelectorAll('[role="tab"]')];
    this.shown = null; // the pane in sight
    this.opener = null;
    for (const tab of this.tabs) tab.onclick = () => this.choose(tab);
    sheet.querySelector('[role="tablist"]').addEventListener("keydown", (event) => this.step(event));
    sheet.querySelector("#library-close").onclick = () => this.close();
    sheet.addEventListener("keydown", (event) => event.code === "Escape" && this.close());
  }

  /** Open at the tab of a pane's id, or where it was left. */
  open(pane = "") {
    const tab = this.tabs.find((one) => one.getAttribute("aria-controls") === pane);
    this.opener = document.activeElement;
    document.querySelector("main").inert = true;
    if (!this.sheet.open) this.sheet.show();
    this.choose(tab ?? this.tabs.find((one) => one.getAttribute("aria-selected") === "true"));
  }

  close() {
    if (!this.sheet.open) return;
    this.sheet.close();
    this.leave();
  }

  choose(chosen) {
    for (const tab of this.tabs) {
      tab.setAttribute("aria-selected", String(tab === chosen));
      tab.tabIndex = tab === chosen ? 0 : -1;
      paneOf(tab).hidden = tab !== chosen;
    }
    chosen.focus();
    if (this.shown === paneOf(chosen)) return;
    this.shown?.dispatchEvent(new Event("hide"));
    this.shown = paneOf(chosen);
    this.shown.dispatchEvent(new Event("show"));
  }

  /** Arrow keys move between tabs, and drive nothing meanwhile. */
  step(event) {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.code];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    const at = this.tabs.indexOf(event.target) + by;
    this.choose(this.tabs.at(at % this.tabs.length));
  }

  leave() {
    document.querySelector("main").inert = false;
    this.shown?.dispatchEvent(new Event("hide"));
    this.shown = null;
    this.opener?.focus();
  }
}

function paneOf(tab) {
  return document.getElementById(tab.getAttribute("aria-controls"));
}
