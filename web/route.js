// The way to the goal: on the map, and in words how far it still is or why there is none.

import { colour, dot, polyline } from "./canvas.js";
import { rows } from "./frame.js";
import { layer } from "./layers.js";

layer("route", { label: "Way to the goal", z: 48, draw: drawRoute });

/** From the robot through the places that are still to be passed. */
function drawRoute(context, { pose, pixel }, { header, arrays }) {
  const places = rows(arrays.route);
  if (!places.length || !pose) return;
  context.strokeStyle = context.fillStyle = colour("goal");
  context.lineWidth = 3 * pixel;
  context.globalAlpha = 0.85;
  if (header.state !== "driving") context.setLineDash([7 * pixel, 6 * pixel]);
  polyline(context, [pose, ...places]);
  context.setLineDash([]);
  for (const place of places.slice(0, -1)) dot(context, place, 4 * pixel);
}

/** A line over the map that says how it stands with the way; nothing while there is no goal. */
export class RouteState {
  constructor(stage, connection) {
    this.line = document.createElement("p");
    this.line.id = "route-state";
    this.line.setAttribute("role", "status");
    this.line.hidden = true;
    stage.append(this.line);
    connection.addEventListener("route", ({ detail }) => this.show(detail.header));
  }

  show({ state, remaining_m: metres, reason }) {
    const text = {
      none: "",
      planning: "Planning the way …",
      driving: `${metres.toFixed(metres < 10 ? 1 : 0)} m to go`,
      blocked: `Stopped: ${reason}. Choose another place, or drive by hand.`,
    }[state];
    this.line.hidden = text === "";
    this.line.setAttribute("aria-live", state === "driving" ? "off" : "polite"); // nobody wants every metre read out
    this.line.dataset.state = state;
    if (this.line.textContent !== text) this.line.textContent = text;
  }
}
