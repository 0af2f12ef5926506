// The robot's and the server's health: the chips in the header and the table.

const LOW_BATTERY = 25.2; // volts of 24 NiMH cells at 1.05 V each
const EMPTY_BATTERY = 24.0;

const STATES = { armed: "armed", "link lost": "standing" }; // on its feet; without commands it only balances
const STOPS = { link: "no commands", none: "none", command: "asked for" };
const HARMLESS_STOPS = [null, "none", "command", "link", "boot"];

export class Health {
  constructor(table) {
    this.table = table;
    this.status = null;
    this.tilt = 0;
    this.age = null; // s
  }

  show(status) {
    this.status = status;
    const { robot, filter, link } = status;
    const volts = robot.battery_volts;
    chip("battery", volts === null ? "–" : `${volts.toFixed(1)} V`, batteryLevel(volts));
    chip("link", `${link.lost_percent.toFixed(1)} %`, level(link.lost_percent, 5, 20));
    chip("filter", filterText(filter), filterLevel(filter));
    this.fill(rowsOf(status));
  }

  /** Tilt in rad, age of the newest reading in s. */
  move(tilt, age) {
    const degrees = (tilt * 180) / Math.PI;
    chip("tilt", `${degrees >= 0 ? "+" : "−"}${Math.abs(degrees).toFixed(1)}°`, level(Math.abs(degrees), 12, 25));
    chip("age", age < 10 ? `${(1000 * age).toFixed(0)} ms` : `${age.toFixed(0)} s`, level(age, 0.5, 1.0));
  }

  fill(rows) {
    const parts = rows.flatMap(([name, value, mark]) => {
      if (value === undefined) return [element("dt", name, "group")];
      const shown = element("dd", value);
      if (mark) shown.dataset.level = mark;
      return [element("dt", name), shown];
    });
    this.table.replaceChildren(...parts);
  }
}

function rowsOf({ robot, filter, link, map, driver, recording, version }) {
  const stopped = !HARMLESS_STOPS.includes(robot.stop_reason);
  return [
    ["Robot"],
    ["State", STATES[robot.state] ?? robot.state ?? "not heard", STATES[robot.state] ? "" : robot.state ? "warn" : "bad"],
    ["Last stop", STOPS[robot.stop_reason] ?? robot.stop_reason ?? "–", stopped ? "bad" : ""],
    ["Battery", volts(robot.battery_volts), batteryLevel(robot.battery_volts)],
    ["Current", robot.battery_amperes === null ? "–" : `${robot.battery_amperes.toFixed(2)} A`],
    ...((robot.charger_volts ?? 0) > 5 ? [["Charger", volts(robot.charger_volts)]] : []),
    ["Driven", `${robot.distance_m.toFixed(1)} m`],
    ["Link"],
    ["Radio", link.connected ? link.names.join(", ") : "not connected", link.connected ? "" : "bad"],
    ...(link.error ? [["Fault", link.error, "bad"]] : []),
    ["Reconnects", String(link.reconnects), link.reconnects ? "warn" : ""],
    ["Frame loss", `${link.lost_percent.toFixed(1)} %`, level(link.lost_percent, 5, 20)],
    ["Silent for", link.silence_s === null ? "–" : `${Math.round(1000 * link.silence_s)} ms`, level(link.silence_s ?? 0, 0.5, 2)],
    ["Path filter"],
    ["Process", filter.state, filterLevel(filter)],
    ["Particles", particles(filter), filter.particles < filter.wanted_particles ? "warn" : ""],
    ["Effective", Math.round(filter.effective_particles).toLocaleString("en")],
    ["Resampled", `${filter.resamplings} times`],
    ["Load", `${Math.round(100 * filter.load)} %`, level(filter.load, 0.7, 0.95)],
    ["Restarts", String(filter.restarts), filter.restarts ? "warn" : ""],
    ["Map"],
    ["Vertices", `${map.vertices}, ${map.fixed_depth} settled`],
    ["Affinity", map.affinity.toFixed(1)],
    ["Plausibility", map.plausibility.toFixed(1)],
    ["Session"],
    ["Watching", String(driver.viewers)],
    ["Recorded", recording ? recording.split("/").pop().replace(/^run-|\.rlog$/g, "") : "no"],
    ["Version", version],
  ];
}

function particles({ particles: now, wanted_particles: wanted }) {
  return now < wanted ? `${now.toLocaleString("en")} of ${wanted.toLocaleString("en")}` : now.toLocaleString("en");
}

function volts(value) {
  return value === null ? "–" : `${value.toFixed(1)} V`;
}

function batteryLevel(value) {
  if (value === null) return "";
  return value < EMPTY_BATTERY ? "bad" : value < LOW_BATTERY ? "warn" : "";
}

function filterText(filter) {
  if (filter.state === "idle" || filter.state === "busy") return `${Math.round(100 * filter.load)} % load`;
  return filter.state;
}

function filterLevel(filter) {
  return { failed: "bad", restarting: "bad", starting: "warn" }[filter.state] ?? "";
}

function level(value, warn, bad) {
  return value >= bad ? "bad" : value >= warn ? "warn" : "";
}

function chip(name, text, mark) {
  const item = document.getElementById(`chip-${name}`);
  item.lastElementChild.textContent = text;
  item.dataset.level = mark;
}

function element(tag, text, className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = className;
  return made;
}
