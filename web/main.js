// The page: joins the connection, the drawings and the controls.

import { Assist } from "./assist.js";
import { shapeAs } from "./canvas.js";
import { Connection } from "./connection.js";
import { Driver } from "./drive.js";
import { Gamepads } from "./gamepad.js";
import { Handover } from "./handover.js";
import { GoalCard } from "./goal_card.js";
import { Health } from "./health.js";
import { Help } from "./help.js";
import { HistogramView } from "./histogram.js";
import { Library } from "./library.js";
import { LocalView } from "./local.js";
import { PlaceNames } from "./labels.js";
import { Switches } from "./layers.js";
import { MapView } from "./map.js";
import { listenToKeys } from "./map_keys.js";
import { MapsPane } from "./maps.js";
import { ProfileView } from "./profile.js";
import { Recordings } from "./recordings.js";
import { Replay, askedRecording, streamOf } from "./replay.js";
import { RouteState } from "./route.js";
import { RunCard, runText } from "./run.js";
import { Scene } from "./scene.js";
import { Suggestions } from "./suggestions.js";
import { offerThemes } from "./theme.js";
import { toast } from "./toast.js";
import { closenessOf } from "./viewport.js";

const $ = (id) => document.getElementById(id);
const TURN = 250; // ms between two looks at how fresh the picture is

const recording = askedRecording();
const connection = recording === null ? new Connection() : new Connection(streamOf(recording));
const replay = recording === null ? null : new Replay($("replay-bar"), connection, recording);
const driver = new Driver(connection, $("stick"));
const assist = new Assist($("shared"), $("assist"), driver);
const handover = new Handover($("driver-request"), $("ask"), connection, driver);
new Gamepads(driver, $("gamepad"));
const health = new Health($("health"));
const local = new LocalView($("local"));
const histogram = new HistogramView($("histogram"));
const profile = new ProfileView($("profile"));
const map = new MapView($("map"), connection, proposeGoal);
listenToKeys(map, proposeGoal);
const goals = new GoalCard($("goal-card"), map, driver);
const names = new PlaceNames($("goal-card"), map, () => goals.drop());
const switches = new Switches($("map-layers"), $("map-layers-open"));
const run = new RunCard($("run"), $("whereabouts"));
new RouteState($("map").parentElement, connection);
new Suggestions($("suggestions"), connection, (place) => {
  map.fit(); // it may lie outside of what is shown
  proposeGoal(place);
});
const library = new Library($("library"));
const scene = new Scene($("scene"), $("goal-card"), driver);
new Recordings($("recordings-pane"), connection);
const maps = new MapsPane($("maps-pane"), replay === null);
const help = new Help($("hint"), $("help"));
offerThemes($("theme"));
const page = { status: null, pose: null, driver, connection, map, replay }; // what the browser's console can look at
globalThis.crunch = page;

connection.addEventListener("state", showConnection);
connection.addEventListener("notice", ({ detail }) => {
  if (detail.header.kind === "refused") refuse(detail.header);
});
connection.addEventListener("notice", ({ detail }) => {
  if (detail.header.kind === "ended") driver.endGoal(detail.header.id); // reached, given up, or taken back
});
connection.addEventListener("notice", ({ detail }) => {
  if (detail.header.kind === "proposal" && !driver.runsItself) hearProposal([detail.header.x, detail.header.y]);
});
connection.addEventListener("status", ({ detail }) => showStatus(detail.header));
connection.addEventListener("pose", ({ detail }) => {
  page.pose = detail.header;
  driver.seen = detail.header.t - detail.header.age;
  health.move(detail.header.tilt, connection.age);
});
connection.addEventListener("local", ({ detail }) => {
  local.show(detail);
  delete $("local").parentElement.dataset.empty;
  $("local-figures").textContent = localFigures(detail.header);
  for (const item of document.querySelectorAll("[data-sensor]")) item.hidden = !(item.dataset.sensor in detail.header.beams);
});
connection.addEventListener("histogram", ({ detail }) => {
  histogram.show(detail);
  assist.show(detail);
  delete $("histogram").parentElement.dataset.empty;
  const n = detail.header.valleys.length;
  $("histogram-figures").textContent = n === 1 ? "1 valley" : `${n} valleys`;
});
connection.addEventListener("path", ({ detail }) => {
  profile.show(detail);
  const n = detail.arrays.path.shape[0];
  const settled = detail.header.fixed_depth;
  $("profile-figures").textContent = n > 1 ? `settled up to vertex ${settled} of ${n - 1}` : "";
  $("map").setAttribute("aria-label", `Best map with ${n} vertices, settled up to vertex ${settled}`);
});

function localFigures({ beams, resolution }) {
  return `${Object.keys(beams).join(" and ").replace("infrared", "infra-red")}, ${Math.round(100 * resolution)} cm cells`;
}

function showConnection() {
  const { isOpen, isStale } = connection;
  const [state, text] = !isOpen ? ["bad", "offline, trying again"]
    : replay ? ["good", "replay"]
    : isStale ? ["waiting", "no fresh data"]
    : ["good", connection.roundTrip === null ? "live" : `live, ${connection.roundTrip.toFixed(0)} ms`];
  const pill = $("connection");
  pill.dataset.state = state;
  if (pill.textContent !== text) pill.textContent = text;
  document.body.classList.toggle("stale", isStale);
  document.body.classList.toggle("locked", driver.isLocked);
  if (page.pose) health.move(page.pose.tilt, connection.age);
  showBanner();
}
setInterval(() => {
  showConnection();
  if (driver.source || driver.hasGoal) help.seeDriving(TURN);
}, TURN);

function showStatus(status) {
  page.status = status;
  health.show(status, connection);
  const { driver: who, map: figures, robot } = status;
  shapeAs(robot.name);
  switches.offer(robot.layers);
  showPanels(robot.layers);
  const isMine = who.viewer !== null && who.viewer === connection.viewer;
  driver.maxTurn = who.max_turn;
  driver.runsItself = who.runs_itself;
  document.body.classList.toggle("runs-itself", who.runs_itself);
  map.comeNear(closenessOf(robot.name));
  run.show(robot);
  $("limit").max = who.max_speed;
  $("drive-state").textContent = driveText(status, isMine);
  handover.show(who);
  $("resume").hidden = who.stopped_by === null;
  $("cancel").hidden = who.goal === null || who.autopilot === true; // that is the explorer's
  $("arm").hidden = robot.state === null || robot.state === "armed" || robot.state === "link lost" || (who.runs_itself && who.stopped_by !== null);
  $("arm").textContent = who.runs_itself ? "Begin a run" : "Arm";
  $("disarm").hidden = !who.runs_itself || robot.state !== "armed";
  $("autopilot").hidden = who.autopilot === null;
  $("autopilot").setAttribute("aria-pressed", String(who.autopilot === true));
  $("autopilot").textContent = who.exploring === null ? "Autopilot" : "Explore";
  const [one, many] = who.runs_itself ? ["bump", "bumps"] : ["vertex", "vertices"];
  $("map-figures").textContent = figures.vertices
    ? `${figures.vertices} ${figures.vertices === 1 ? one : many}, ${figures.path_length_m.toFixed(1)} m` : `waiting for the first ${one}`;
  $("health-figures").textContent = titled(robot.name) + (robot.virtual ? ", virtual" : "");
  document.title = `${titled(robot.name)} · ${figures.vertices} ${many}`;
  showBanner();
}

/** Panels and marks of topics that this robot has not are left out, as are those that something else stands for. */
function showPanels(topics) {
  for (const shown of document.querySelectorAll("[data-topic], [data-without]")) {
    const { topic, without } = shown.dataset;
    shown.hidden = (topic !== undefined && !topics.includes(topic)) || topics.includes(without);
  }
}

/** "Maze Runner" for maze_runner. */
function titled(name) {
  return name.split("_").map((word) => word[0].toUpperCase() + word.slice(1)).join(" ");
}

const EXPLORING = { looking: "looks around", driving: "explores", following: "follows a wall", done: "has explored all that it can reach" };

function driveText({ driver: who, robot }, isMine) {
  if (who.stopped_by !== null) return "stopped";
  if (who.runs_itself) return runText(robot);
  if (who.autopilot) return EXPLORING[who.exploring] ?? "the autopilot drives";
  if (who.goal !== null) return isMine ? "driving to your objective" : "driving to an objective";
  if (isMine) return "you drive";
  if (who.exploring === "done") return EXPLORING.done + (who.abandoned ? `, but not ${who.abandoned} place${who.abandoned === 1 ? "" : "s"} at its edge` : "");
  return who.viewer === null ? "nobody drives" : `${who.viewer} drives`;
}

function showBanner() {
  const [level, text] = bannerText();
  const banner = $("banner");
  banner.hidden = text === "";
  banner.dataset.level = level;
  if (banner.textContent !== text) banner.textContent = text;
}

function bannerText() {
  const { status } = page;
  if (connection.stopFailure) return ["bad", `STOP did not reach the robot: ${connection.stopFailure}. Press it again, or switch the robot off by hand.`];
  if (connection.refusal) return ["bad", `This cannot be replayed: ${connection.refusal}.`];
  if (replay) return connection.isOpen || !status ? ["", ""] : ["bad", "The server cannot be reached. Trying again."];
  if (!connection.isOpen) return status ? ["bad", "The server cannot be reached. Trying again; the robot has been told to stand still."] : ["", ""];
  if (!status) return ["", ""];
  if (status.driver.stopped_by !== null) {
    const by = status.driver.stopped_by === connection.viewer ? "you" : status.driver.stopped_by;
    return ["warn", `Stopped by ${by}. Press Resume to ${status.driver.runs_itself ? "begin a run again" : "drive"}.`];
  }
  if (!status.session.running) return ["warn", "No session runs: nothing is recorded or mapped. Begin one in the Library."];
  if (!status.link.connected) return ["bad", "The robot's link is not connected."];
  if (status.robot.state === "fallen") return ["bad", "The robot has fallen. Stand it up, then press Arm."];
  if (connection.isLocked) return ["warn", "No fresh data: driving is locked until it comes back."];
  if (status.filter.state === "restarting") return ["warn", `The path filter was lost (${status.filter.reason}) and is started again. Nothing mapped is lost.`];
  if (status.filter.state === "failed") return ["bad", `The path filter was given up (${status.filter.reason}). Driving and recording go on.`];
  return ["", ""];
}

// Goals: a click proposes, a button confirms.

function proposeGoal(place) {
  if (replay) return;
  goals.propose(place);
  names.offer(place);
}

function hearProposal(place) {
  if (replay) return;
  goals.hear(place, () => {
    goals.show(place);
    names.offer(place);
  });
}

$("cancel").onclick = () => driver.cancelGoal();

// Buttons.

$("stop").onclick = () => driver.stop();
$("resume").onclick = () => connection.send({ type: "resume" });
$("arm").onclick = () => connection.send({ type: "arm", armed: true });
$("disarm").onclick = () => connection.send({ type: "arm", armed: false });
$("autopilot").onclick = () => connection.send({ type: "autopilot", on: page.status?.driver.autopilot !== true });
$("map-follow").onclick = () => map.follow(!map.isFollowing);
$("map").addEventListener("follow", ({ detail }) => $("map-follow").setAttribute("aria-pressed", String(detail)));
$("library-open").onclick = () => {
  scene.close();
  library.open();
};
$("scene-open").hidden = replay !== null; // it shows the present
$("scene-open").onclick = () => {
  library.close();
  scene.open();
};
$("map-fit").onclick = () => map.fit();
$("map-in").onclick = () => map.zoom(1.35);
$("map-out").onclick = () => map.zoom(1 / 1.35);
$("map-save").hidden = replay !== null;
$("map-save").onclick = () => maps.save();

$("menu-open").onclick = () => openMenu(!$("menu").classList.contains("open"));
document.addEventListener("click", ({ target }) => !$("menu-open").contains(target) && openMenu(false));
document.addEventListener("pointerdown", ({ target }) => !target.closest("nav") && openMenu(false), { capture: true }); // a drag is no click

/** On narrow screens the header's links are behind one button. */
function openMenu(isOpen) {
  $("menu").classList.toggle("open", isOpen);
  $("menu-open").setAttribute("aria-expanded", String(isOpen));
}

// What floats below the header and the banner knows how high they are.
const heights = new ResizeObserver(() => {
  const [header, banner] = [document.querySelector("header").offsetHeight, $("banner").offsetHeight];
  document.documentElement.style.setProperty("--header", `${header}px`);
  document.documentElement.style.setProperty("--top", `${header + banner}px`);
});
for (const bar of [document.querySelector("header"), $("banner")]) heights.observe(bar);

// Settings that last.

function setLimit(limit) {
  driver.limit = limit;
  $("limit-value").textContent = `${limit.toFixed(2)} m/s`;
}
$("limit").value = localStorage.getItem("limit") ?? "0.3";
setLimit(Number($("limit").value));
$("limit").oninput = (event) => {
  setLimit(Number(event.target.value));
  localStorage.setItem("limit", event.target.value);
};

function refuse({ word, id, reason }) {
  if (word === "goal" || word === "hold") driver.endGoal(id);
  toast(reason[0].toUpperCase() + reason.slice(1));
}
