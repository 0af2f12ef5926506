// The line to the server: connects again by itself, acknowledges what was shown, and measures the way there and back.

import { decodeFrame } from "./frame.js";

const FIRST_RETRY = 300; // ms
const LAST_RETRY = 4000;

export class Connection extends EventTarget {
  constructor() {
    super();
    this.viewer = null; // the name that the server gave this page
    this.roundTrip = null; // ms
    this.heard = -Infinity; // performance.now() of the newest frame
    this.retry = FIRST_RETRY;
    this.newest = 0;
    this.isAckDue = false;
    this.open();
    setInterval(() => this.send({ type: "ping", sent: performance.now() }), 1000);
  }

  get isOpen() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  /** Milliseconds since the server was last heard. */
  get silence() {
    return performance.now() - this.heard;
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss://" : "ws://";
    const socket = new WebSocket(`${scheme}${location.host}/api/v1/stream`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.retry = FIRST_RETRY;
      this.announce("state");
    };
    socket.onclose = () => {
      this.viewer = null;
      this.announce("state");
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
    if (frame.topic === "notice" && frame.header.kind === "hello") this.viewer = frame.header.viewer;
    if (frame.topic === "notice" && frame.header.kind === "pong") this.roundTrip = performance.now() - frame.header.sent;
    this.announce("frame", frame);
    this.announce(frame.topic, frame);
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

  announce(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
