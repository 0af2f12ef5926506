// The view in three dimensions: a sheet over the panels with viser's page in a frame, which is there only while the sheet
// is open. STOP, the banner and the card of a proposed place stay over it, and its keys stop the robot as the page's do.

import { element } from "./elements.js";

const LISTEN = 100; // ms between two looks at whether the frame has another window by now
const ADDRESS = "/viser/?hideViserLogo";

export class Scene {
  /** `card` asks whether to drive to a place; it comes along into the sheet. */
  constructor(sheet, card, driver) {
    this.sheet = sheet;
    this.card = card;
    this.driver = driver;
    this.stage = sheet.querySelector(".stage");
    this.home = card.parentElement;
    this.opener = null;
    this.press = this.press.bind(this);
    sheet.querySelector("#scene-close").onclick = () => this.close();
    sheet.addEventListener("keydown", (event) => event.code === "Escape" && !this.card.contains(event.target) && this.close());
  }

  open() {
    if (this.sheet.open) return;
    this.opener = document.activeElement;
    document.querySelector("main").inert = true;
    const frame = element("iframe", { src: ADDRESS, title: "View in three dimensions" });
    this.stage.append(frame, this.card);
    this.listen(frame);
    this.sheet.show();
    this.sheet.querySelector("#scene-close").focus();
  }

  /** Hear the keys of the frame, also while it still loads; on the way its window becomes another. */
  listen(frame) {
    if (!frame.isConnected) return;
    frame.contentWindow.addEventListener("keydown", this.press, { capture: true });
    setTimeout(() => this.listen(frame), LISTEN);
  }

  close() {
    if (!this.sheet.open) return;
    this.sheet.close();
    this.sheet.querySelector("iframe").remove();
    this.home.append(this.card);
    document.querySelector("main").inert = false;
    const isSeen = this.opener.checkVisibility();
    (isSeen ? this.opener : document.getElementById("menu-open")).focus(); // it may have been in the menu
  }

  /** A key in the frame, which the page itself does not hear. */
  press(event) {
    if (event.code !== "Space" && event.code !== "Escape") return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.driver.stop();
  }
}
