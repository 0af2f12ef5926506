// Light or dark: as the system has it, until a person chooses.

import { forgetColours } from "./canvas.js";

const root = document.documentElement;

/** Take over what was chosen before, and let a button choose. */
export function offerThemes(button) {
  const chosen = localStorage.getItem("theme");
  if (chosen) wear(chosen);
  button.onclick = () => {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
    const theme = (root.style.colorScheme || dark) === "dark" ? "light" : "dark";
    localStorage.setItem("theme", theme);
    wear(theme);
  };
}

function wear(theme) {
  root.style.colorScheme = theme;
  forgetColours();
}
