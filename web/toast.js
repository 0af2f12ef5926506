// Short messages at the foot of the page. A message may offer one way back: toast("Map deleted", { label: "Undo", run }).

const SHORT = 4000; // ms on the page
const LONG = 10_000; // ms, where there is something to press
const REPEAT = 2500; // ms in which the same words are not said twice

const said = new Map();

/** Say `text`; `level` is "", "good" or "bad". Returns a function that takes the message away. */
export function toast(text, { label = "", run = () => {}, level = "" } = {}) {
  if (!label && performance.now() - (said.get(text) ?? -Infinity) < REPEAT) return () => {};
  said.set(text, performance.now());
  const line = document.createElement("div");
  line.className = "toast";
  line.dataset.level = level;
  const words = document.createElement("span");
  words.textContent = text;
  line.append(words);
  let timer = 0;
  const close = () => {
    clearTimeout(timer);
    line.remove();
  };
  const wait = () => (timer = setTimeout(close, label ? LONG : SHORT));
  if (label) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    button.onclick = () => {
      close();
      run();
    };
    line.append(button);
  }
  line.onpointerenter = () => clearTimeout(timer); // a message that is being read stays
  line.onpointerleave = wait;
  document.getElementById("toasts").append(line);
  wait();
  return close;
}
