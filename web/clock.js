// The server's clock as this page knows it, from pings and pongs: no page's own clock is trusted to agree with it.

const DRIFT = 1e-4; // that two computers' clocks may part by, in seconds per second

export class Clock {
  constructor() {
    this.clear();
  }

  /** Time starts anew: another session, or another server. */
  clear() {
    this.best = null;
  }

  /** A pong with the session's time `t` came `roundTrip` ms after its ping; the least delayed one is believed. */
  hear({ sent, t, speed }, received) {
    const roundTrip = received - sent;
    if (this.best && roundTrip > this.best.roundTrip + DRIFT * (received - this.best.received)) return;
    this.best = { roundTrip, received, t: t + (speed * roundTrip) / 2000, speed };
  }

  /** Seconds of people's time since session time `t`; null before the first pong. */
  since(t) {
    if (!this.best) return null;
    return (performance.now() - this.best.received) / 1000 - (t - this.best.t) / this.best.speed;
  }
}
