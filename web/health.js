// The robot's and the server's health: the chips in the header, and the panel with its groups of figures.

const CHARGING = 5; // volts at the charger's socket above which it is plugged in
const STOPS = "Newest stops";
const PLACES = 4; // where a robot may be that are told
const LONG = 5; // rows above which a group scrolls

const STATES = { armed: "armed", "link lost": "standing" }; // on its feet; without commands it only balances
const RUNNING = { armed: "running", disarmed: "standing", "link lost": "standing" }; // of one that runs by itself

export class Health {
  constructor(box) {
    this.box = box;
    this.tilt = null; // rad
    this.shape = "";
    this.values = [];
  }

  /** Take over the status; `connection` knows the round trip and how old the picture is. */
  show(status, connection) {
    const { robot, filter, link } = status;
    chip("battery", volts(robot.battery_volts), batteryLevel(robot));
    document.getElementById("chip-tilt").hidden = robot.tilt_rad === null;
    chip("link", `${link.lost_percent.toFixed(1)} %`, level(link.lost_percent, 5, 20));
    chip("filter", filterText(filter), filterLevel(filter));
    this.fill(groupsOf(status, connection));
  }

  /** Tilt in rad, age of the newest reading in s. */
  move(tilt, age) {
    const lean = (180 / Math.PI) * (tilt ?? 0); // a robot that cannot tilt tells none
    chip("tilt", degrees(lean), level(Math.abs(lean), 12, 25));
    chip("age", duration(age), level(age, 0.5, 1.0));
  }

  /** Rows keep their elements as long as their names stay, so that selected text is not lost; a reader's place never is. */
  fill(groups) {
    const shape = JSON.stringify(groups.map(([title, rows]) => [title, rows.map(([name]) => name)]));
    const isOther = shape !== this.shape;
    const goBack = placeIn(this.box);
    if (isOther) this.build(groups);
    this.shape = shape;
    groups.flatMap(([, rows]) => rows).forEach(([, value, mark = ""], index) => {
      const shown = this.values[index];
      if (shown.textContent !== value) shown.textContent = shown.title = value;
      shown.dataset.level = mark;
    });
    if (isOther) goBack();
  }

  build(groups) {
    this.values = [];
    const built = groups.map(([title, rows]) => {
      const table = element("dl");
      for (const [name] of rows) {
        const value = element("dd");
        this.values.push(value);
        table.append(element("dt", name), value);
      }
      const group = element("section");
      group.append(element("h3", title), table);
      if (title === STOPS && rows.length > LONG) {
        group.className = "long";
        group.tabIndex = 0; // to be scrolled by keys
        group.setAttribute("aria-label", title);
      }
      return group;
    });
    this.box.replaceChildren(...built);
  }
}

/** How far the long group is scrolled, and whether it is read by keys: a function that makes it so again. */
function placeIn(box) {
  const before = box.querySelector(".long");
  const [top, isFocused] = [before?.scrollTop ?? 0, before !== null && before === document.activeElement];
  return () => {
    const after = box.querySelector(".long");
    if (after) after.scrollTop = top;
    if (isFocused) after?.focus({ preventScroll: true });
  };
}

function groupsOf(status, connection) {
  return [
    ["Robot", robotRows(status.robot, status.driver.runs_itself)],
    [STOPS, stopRows(status)],
    ["Link", linkRows(status.link, connection)],
    ["Path filter", filterRows(status.filter, status.driver.runs_itself)],
    ["Map", status.driver.runs_itself ? feltRows(status) : mapRows(status.map)],
    ["Server", serverRows(status)],
  ];
}

function robotRows(robot, runsItself) {
  const [left, right] = robot.motor_amperes ?? [];
  const states = runsItself ? RUNNING : STATES;
  return [
    ["State", states[robot.state] ?? robot.state ?? "not heard", states[robot.state] ? "" : robot.state ? "warn" : "bad"],
    ...lastWordsRow(robot.last_words),
    ["Battery", volts(robot.battery_volts), batteryLevel(robot)],
    ...(robot.battery_amperes === null ? [] : [["Current", amperes(robot.battery_amperes)]]),
    ...(robot.powers ? [["Power", robot.powers.map((power) => `${signed(100 * power, 0)} %`).join(", ")]] : []),
    ...miceRow(robot.mice),
    ...(robot.motor_amperes ? [["Motors", `${signed(left)}, ${signed(right)} A`]] : []),
    ...(robot.charger_volts === null ? [] : [["Charger", robot.charger_volts > CHARGING ? `${volts(robot.charger_volts)}, ${amperes(robot.charger_amperes)}` : "not plugged in"]]),
    ...(robot.tilt_rad === null ? [] : [["Tilt", degrees((180 / Math.PI) * robot.tilt_rad)]]),
    ["Driven", `${robot.distance_m.toFixed(1)} m`],
  ];
}

/** How often the mice's odometry was not believed and the motors' filled in, where the robot has mice. */
function miceRow(mice) {
  if (!mice) return [];
  const share = mice.steps ? (100 * mice.filled_in) / mice.steps : 0;
  return [["Mice", `not believed ${share.toFixed(1)} %`, level(share, 10, 50)]];
}

/** What the drive board did when a reset cut it off, if it remembers. */
function lastWordsRow(words) {
  if (!words) return [];
  const why = words.reason === "none" ? "" : ` (${words.reason})`;
  return [["Was reset", `after ${clock(words.uptime)}, ${STATES[words.state] ?? words.state}${why}`, "warn"]];
}

function stopRows({ stops = [] }) {
  if (!stops.length) return [["None yet", ""]];
  return stops.map(({ t, reason, by }) => [clock(t), by ? `${reason} (${by})` : reason]);
}

function linkRows(link, { roundTrip, age }) {
  return [
    ["Radio", link.connected ? link.names.join(", ") : "not connected", link.connected ? "" : "bad"],
    ...(link.error ? [["Fault", link.error, "bad"]] : []),
    ["Frame loss", `${link.lost_percent.toFixed(1)} %`, level(link.lost_percent, 5, 20)],
    ["Silent for", duration(link.silence_s), level(link.silence_s ?? 0, 0.5, 2)],
    ["Reconnects", String(link.reconnects), link.reconnects ? "warn" : ""],
    ["To this page", roundTrip === null ? "–" : `${roundTrip.toFixed(0)} ms and back`, level(roundTrip ?? 0, 250, 1000)],
    ["Picture age", duration(age), level(age, 0.5, 1)],
  ];
}

function filterRows(filter, runsItself) {
  const { particles, wanted_particles: wanted } = filter;
  const isShort = particles < wanted;
  return [
    ["Process", filter.state, filterLevel(filter)],
    ["Particles", isShort ? `${count(particles)} of ${count(wanted)}` : count(particles), isShort ? "warn" : ""],
    ["Effective", count(Math.round(filter.effective_particles))],
    ...(runsItself ? [] : [["Resampled", `${filter.resamplings} times`]]),
    ["Load", `${Math.round(100 * filter.load)} %`, level(filter.load, 0.7, 0.95)],
    ["Restarts", String(filter.restarts), filter.restarts ? "warn" : ""],
  ];
}

function mapRows(map) {
  return [
    ["Vertices", `${count(map.vertices)}, ${count(map.fixed_depth)} settled`],
    ["Affinity", map.affinity.toFixed(1)],
    ["Plausibility", map.plausibility.toFixed(1)],
  ];
}

/** What bumps told: how many there were, and the likeliest places on a given map. */
function feltRows({ map, robot: { whereabouts } }) {
  const places = whereabouts?.places.slice(0, PLACES) ?? [];
  return [
    ["Bumps", count(map.vertices)],
    ...(whereabouts ? [["Localized", whereabouts.localized ? "yes" : "no", whereabouts.localized ? "" : "warn"]] : []),
    ...places.map(({ x, y, share }) => [`${Math.round(100 * share)} %`, `at ${x.toFixed(2)}, ${y.toFixed(2)} m`]),
  ];
}

function serverRows({ t, driver, recording, version, loop }) {
  return [
    ["Session", clock(t)],
    ["Recorded", recording ? recording.split("/").pop().replace(/^run-|\.rlog$/g, "") : "no"],
    ["Watching", String(driver.viewers)],
    ...(loop ? [["Loop delay", `${loop.late_p99_ms.toFixed(0)} ms`, level(loop.late_p99_ms, 100, 500)]] : []),
    ["Version", version],
  ];
}

function count(n) {
  return n.toLocaleString("en");
}

function volts(value) {
  return value === null ? "–" : `${value.toFixed(1)} V`;
}

function amperes(value) {
  return value === null || value === undefined ? "–" : `${value.toFixed(2)} A`;
}

/** A figure either way, with a minus sign as long as a plus. */
function signed(value, digits = 2) {
  return value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−");
}

function degrees(lean) {
  return `${lean > -0.05 ? "+" : "−"}${Math.abs(lean).toFixed(1)}°`;
}

/** Seconds as people read them. */
function duration(seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return "–";
  return seconds < 10 ? `${Math.round(1000 * seconds)} ms` : `${seconds.toFixed(0)} s`;
}

/** Session time as m:ss. */
function clock(seconds) {
  return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
}

function batteryLevel({ battery_volts: value, battery_low_volts: low, battery_empty_volts: empty }) {
  if (value === null) return "";
  return value < empty ? "bad" : value < low ? "warn" : "";
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
  if (item.lastElementChild.textContent !== text) item.lastElementChild.textContent = text;
  item.dataset.level = mark;
}

function element(tag, text = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}
