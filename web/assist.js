// Shared driving: a switch that lets the robot bend the driver's direction off obstacles, and a word when it does.

const BENT = 0.15; // rad between wish and command that is worth a word

export class Assist {
  constructor(control, line, driver) {
    this.line = line;
    this.driver = driver;
    control.checked = localStorage.getItem("shared") !== "no";
    driver.isShared = control.checked;
    control.onchange = () => {
      driver.isShared = control.checked;
      localStorage.setItem("shared", control.checked ? "yes" : "no");
    };
  }

  /** The histogram's frame: what is in the way, what was wished and what was commanded. */
  show({ header, arrays }) {
    const text = this.driver.source && this.driver.isShared ? explain(header, arrays.densities, this.driver.wish) : "";
    this.line.hidden = text === "";
    if (this.line.textContent !== text) this.line.textContent = text;
  }
}

function explain({ goal, steering, threshold }, densities, [forward]) {
  if (forward < 0) return densities[densities.length / 2] >= threshold ? "Something is behind: slowly" : "";
  if (forward === 0) return "";
  if (goal !== null && steering !== null && Math.abs(steering - goal) > BENT) return "Steering around an obstacle";
  return densities[0] >= threshold ? "Something is ahead: slowly" : "";
}
