// The line to the server: connects again by itself, acknowledges what was shown, and knows how old the picture is.

import { Clock } from "./clock.js";
import { decodeFrame } from "./frame.js";
import { ask } from "./rest.js";

const STREAM = "/api/v1/stream";
const ANSWER = 3000; // ms: a stop without an answer by then has not been heard
const NOT_PLAYABLE = 4004; // closed for good: there is no such recording
const STALE = 1; // s: an older picture is greyed
const LOCKED = 1.5; // s: nobody drives by an older one
const FIRST_RETRY = 300; // ms
const LAST_RETRY = 4000;

export class Connection extends EventTarget {
  /** A stream other than the live one has no present: its picture is never too old. */
  constructor(path = STREAM) {
    super();
    this.path = path;
    this.isLive = path === STREAM;
    this.clock = new Clock();
    this.taken = null; // session time at which the newest reading was taken
    this.viewer = null; // the name that the server gave this page
    this.stopFailure = ""; // why the last stop was not heard
    this.refusal = ""; // why the server will not show this at all
    this.roundTrip = null; // ms
    this.heard = -Infinity; // performance.now() of the newest frame
    this.retry = FIRST_RETRY;
    this.newest = 0;
    this.isAckDue = false;
    this.open();
    setInterval(() => this.ping(), 1000);
  }

  get isOpen() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  /** Milliseconds since the server was last heard. */
  get silence() {
    return performance.now() - this.heard;
  }

  /** Seconds since what the picture shows was read by the robot; Infinity where that is not known. */
  get age() {
    if (!this.isLive) return 0;
    if (this.taken === null) return Infinity;
    return Math.max(0, this.clock.since(this.taken) ?? Infinity);
  }

  get isStale() {
    return !this.isOpen || this.age > STALE;
  }

  /** Whether the picture is too old to drive by. */
  get isLocked() {
    return !this.isLive || !this.isOpen || this.age > LOCKED;
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss://" : "ws://";
    const socket = new WebSocket(`${scheme}${location.host}${this.path}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.retry = FIRST_RETRY;
      this.announce("state");
    };
    socket.onclose = ({ code, reason }) => {
      this.viewer = null;
      if (code === NOT_PLAYABLE) this.refusal = reason;
      this.announce("state");
      if (this.refusal) return;
      setTimeout(() => this.open(), this.retry);
      this.retry = Math.min(LAST_RETRY, 2 * this.retry);
    };
    socket.onmessage = (event) => this.receive(event.data);
    this.socket = socket;
  }

  receive(buffer) {
    const frame = decodeFrame(buffer);
    this.heard = performance.now();
    this.newest = frame.sequence;
    this.acknowledgeAfterDrawing();
    if (frame.topic === "notice") this.hearNotice(frame.header);
    if (frame.topic === "pose") this.taken = frame.header.t - frame.header.age;
    this.announce("frame", frame);
    this.announce(frame.topic, frame);
  }

  hearNotice(header) {
    if (header.kind === "hello") this.viewer = header.viewer;
    if (header.kind === "hello" || header.kind === "begin") {
      this.clock.clear();
      this.taken = null;
      this.ping();
    }
    if (header.kind === "pong") {
      this.roundTrip = this.heard - header.sent;
      this.clock.hear(header, this.heard);
    }
  }

  ping() {
    this.send({ type: "ping", sent: performance.now() });
  }

  acknowledgeAfterDrawing() {
    if (this.isAckDue) return;
    this.isAckDue = true;
    requestAnimationFrame(() => {
      this.isAckDue = false;
      this.send({ type: "ack", seq: this.newest });
    });
  }

  /** Send a word, unless the line is closed or so full that the word would arrive late. */
  send(word) {
    if (this.isOpen && this.socket.bufferedAmount < 4096) this.socket.send(JSON.stringify(word));
  }

  /** Tell the robot to stand still: however full the line is, past it while it is closed, and also from a replay. */
  async stop() {
    const word = { type: "stop" };
    this.stopFailure = "";
    try {
      if (this.isLive && this.isOpen) this.socket.send(JSON.stringify(word));
      else await ask("commands", { method: "POST", body: word, signal: AbortSignal.timeout(ANSWER) });
    } catch ({ message }) {
      this.stopFailure = message;
    }
    this.announce("state");
  }

  announce(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
