// Elements in one line: element("button", { type: "button", onclick: go }, "Go").

/** An element with properties (`class`, `aria-...`, `data-...` and other attributes as well) and children. */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}
