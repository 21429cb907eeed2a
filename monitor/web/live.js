"use strict";
// The page itself: what came over the WebSocket, what is shown of it, and the keys.

const PROTOCOL = 1;
const QUIET_MS = 4000;     // no frame for so long: the connection is dead, whatever the browser thinks
const READY_MS = 30000;    // a daemon that compiles its kernels has nothing to say for a while
const FIRST_MS = 500, LONGEST_MS = 10000;
const SHOW_MS = 250;
const LONGEST_S = 300;     // the longest window; no more is remembered

/** A WebSocket that is opened anew for ever: waits double up to ten seconds, each one by chance. */
class Connection {
  constructor(address, heard, changed) {
    Object.assign(this, { address, heard, changed, failures: 0, open: false, accepted: false, reason: "", heard_ms: 0 });
    setInterval(() => this._watch(), 1000);
    addEventListener("online", () => this.hurry());
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.hurry(); });
    this._connect();
  }

  /** Try now instead of waiting any longer. */
  hurry() { if (!this.socket) { clearTimeout(this.waiting); this._connect(); } }

  _connect() {
    const socket = this.socket = new WebSocket(this.address);
    this.heard_ms = performance.now();
    this.accepted = false;
    socket.onopen = () => { this.accepted = true; this.changed(); };
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      this.heard_ms = performance.now();
      this.failures = 0;
      if (!this.open) { this.open = true; this.changed(); }
      this.heard(JSON.parse(data));
    };
    socket.onclose = ({ reason }) => { if (socket === this.socket) this._lost(reason); };
  }

  _lost(reason) {
    const { socket } = this;
    this.socket = null;
    this.open = this.accepted = false;
    this.reason = reason;
    socket.close();
    const wait_ms = Math.min(LONGEST_MS, FIRST_MS * 2 ** this.failures) * (0.5 + Math.random());
    this.failures = Math.min(this.failures + 1, 10);
    this.waiting = setTimeout(() => this._connect(), wait_ms);
    this.changed();
  }

  _watch() {
    const limit_ms = this.open ? QUIET_MS : READY_MS;
    if (this.socket && performance.now() - this.heard_ms > limit_ms) this._lost("it no longer answers");
  }
}

/** Everything the page knows, and the parts that show it. */
class App {
  constructor(catalogue) {
    this.catalogue = catalogue;
    const drawn = catalogue.charts.flatMap(({ series }) => series.flatMap(({ column, std }) => [column, std ?? column]));
    this.store = new Store(new Set(drawn));
    this.charts = new Map();  // on the page
    this.made = new Map();    // all that were ever: a figure is made once
    this.timeline = new TimelineChart(catalogue.timeline);
    this.banner = new Banner(catalogue.looks);
    this.table = new StateTable(catalogue.looks);
    this.facts = new Facts();
    this.view = { window_s: 120, paused_s: null };
    this.painter = new Painter(() => ({ store: this.store, view: this.now() }));
    this.arrivals = [];
    this.forget();
    byId("timeline").append(this.timeline.element);
    this._open(this.timeline);
    this._controls();
    byId("charts").addEventListener("pointed", () => this._values());
    this.connection = new Connection(address(), (message) => this.take(message), () => this.say());
    setInterval(() => this.say(), 1000);
    document.addEventListener("visibilitychange", () => { if (!document.hidden) { this.show(); this.painter.ask(); } });
  }

  /** Begin anew: what was shown is of another flight. */
  forget() {
    Object.assign(this, { run: null, hello: null, link: null, latency: undefined, recorder: undefined, process: undefined });
    Object.assign(this, { streams: {}, rejected: {}, channels: {}, standing: new Map(), faults: new Map(), events: new Map() });
    Object.assign(this, { missed: 0, last: null, sounded: new Set() });
    this.view.paused_s = null;
    this.store.absent.clear();
    this.timeline.clear();
    for (const chart of this.charts.values()) chart.element.remove();
    this.charts.clear();
  }

  /** Where the window ends, how long it is, and what its end is called. */
  now() {
    const { window_s, paused_s } = this.view;
    return { window_s, to_s: paused_s ?? this.store.t_s, end: paused_s !== null ? "paused" : this.lost || this.silent ? "last" : "now" };
  }

  /** Frames per second over the last seconds. */
  rate() {
    const since = performance.now() - 5000;
    while (this.arrivals[0] < since) this.arrivals.shift();
    return this.arrivals.length / 5;
  }

  take(message) {
    if (message.kind === "hello") this._hello(message);
    else if (message.kind === "history") for (const frame of message.frames) this.store.take(frame);
    else if (message.kind === "frame") this._frame(message);
    this._places();
    this.say();
    if (!document.hidden) this.painter.ask();
  }

  _hello(hello) {
    if (hello.protocol !== PROTOCOL) return this._outdated();
    if (hello.run !== this.run) {
      this.forget();
      this.run = hello.run;
      this.store.clear(Math.min(8192, Math.ceil(1.2 * LONGEST_S * hello.rate_hz) + 64));
    }
    this.hello = hello;
    this.last = hello.number;
    this.flying = hello.flying;
    this.link = hello.link;
    this.standing.clear();
    this.timeline.clear();
    this.faults = new Map(hello.faults.map((fault) => [fault.number, fault]));
    this.events = new Map(hello.events.map((event) => [event.number, event]));
    this._changes(hello.timeline, hello.t_s ?? 0);
    this._seldom(hello);
  }

  _frame(frame) {
    if (this.last !== null && frame.number > this.last + 1) this.missed += frame.number - this.last - 1;
    this.last = frame.number;
    this.heard_at = new Date();
    this.arrivals.push(performance.now());
    if (this.arrivals.length > 200) this.arrivals.shift();
    if (frame.t_s !== null && frame.t_s < this.store.t_s) this._begun_anew(frame.t_s);
    this.store.take(frame);
    this.flying = frame.flying;
    this.link = frame.link;
    this._changes(frame.changes ?? {}, frame.t_s ?? 0);
    for (const fault of frame.faults ?? []) this._keep(this.faults, fault);
    for (const event of frame.events ?? []) this._keep(this.events, event);
    this._seldom(frame);
  }

  /** The vehicle's clock went back: what stands, stands from here on. */
  _begun_anew(t_s) {
    this.timeline.clear();
    for (const [sensor, one] of this.standing) if (one.state !== "absent") this.timeline.take(sensor, [{ ...one, t_s }], t_s);
  }

  _keep(map, one) {
    map.set(one.number, one);
    if (map.size > 100) map.delete(map.keys().next().value);
  }

  _seldom(message) {
    for (const name of ["streams", "latency", "recorder", "process", "rejected", "channels"]) {
      if (name in message) this[name] = message[name];
    }
  }

  _changes(changes, t_s) {
    for (const [sensor, standings] of Object.entries(changes)) {
      if (!standings.length) continue;
      this.standing.set(sensor, standings.at(-1));
      this.store.fitted(sensor, standings.at(-1).state !== "absent");
      if (standings.at(-1).state !== "absent" || this.timeline.spans.has(sensor)) this.timeline.take(sensor, standings, t_s - LONGEST_S - 30);
    }
  }

  /** Charts come with their first value, each in its place. */
  _places() {
    for (const [i, spec] of this.catalogue.charts.entries()) {
      const there = this.charts.get(spec.key), needed = LineChart.needed(spec, this.store);
      if (there && !needed) { there.element.remove(); this.charts.delete(spec.key); }
      if (there || !needed) continue;
      const chart = this.made.get(spec.key) ?? new LineChart(spec);
      this.charts.set(spec.key, chart);
      const later = this.catalogue.charts.slice(i + 1).map(({ key }) => this.charts.get(key)).find(Boolean);
      byId("charts").insertBefore(chart.element, later?.element ?? null);
      if (!this.made.has(spec.key)) this._open(chart);
      this.made.set(spec.key, chart);
    }
  }

  /** Figures are opened one after another, so that the page answers in between. */
  _open(figure) {
    this.opening = (this.opening ?? Promise.resolve()).then(() => figure.open()).then(() => this.painter.add(figure), console.error);
  }

  /** What must be said even while nobody looks: the title, the alarm, the sound. Then the rest. */
  say() {
    const lost = !this.connection?.open;
    const silent = !lost && (!this.link || this.link.silent);
    const digest = Banner.digest(this.standing, this.catalogue.looks);
    const trouble = lost ? (this.hello ? "no connection" : "connecting") : silent ? "vehicle silent" : null;
    document.title = `${trouble ?? digest.title ?? (digest.calm === "ok" ? "✓ ok" : "○ not judging")} · mavsentry`;
    const aloud = lost ? (this.hello ? "No connection to the daemon. What is shown is old. " : "") : silent && this.link ? "The vehicle is silent. What is shown is old. " : "";
    this.banner.speak(aloud + digest.said || (this.hello ? "No fault." : ""));
    this._sound(digest.lines.filter(({ state }) => state === "faulty" || state === "stopped"), lost && Boolean(this.hello));
    if (lost !== this.lost || silent !== this.silent) this.painter.ask();
    Object.assign(this, { lost, silent, digest });
    document.documentElement.dataset.link = lost ? (this.hello ? "lost" : "opening") : silent ? "silent" : "live";
    if (document.hidden || this.shown) return;
    this.shown = setTimeout(() => { this.shown = null; requestAnimationFrame(() => this.show()); }, SHOW_MS);
  }

  show() {
    const { store, digest, lost, silent } = this;
    const stale = lost || silent;
    this._strip();
    this.banner.show(digest, store.t_s, this.recorder);
    this.table.show(this.standing, store, this.channels, stale);
    this._values();
    this.facts.show(this);
    const paused = this.view.paused_s !== null;
    tell(byId("clock"), store.t_s === null ? "–:––" : minutes(store.t_s));
    tell(byId("phase"), store.t_s === null ? "" : this.flying ? "in flight" : "on the ground");
    tell(byId("paused"), paused ? `Charts paused at ${minutes(this.view.paused_s)}; all else is live.` : "");
    byId("waiting").hidden = this.charts.size > 0;
  }

  _values() {
    for (const chart of this.charts.values()) chart.tell(this.store, this.now(), this.lost || this.silent);
  }

  /** The strip about the connection: which of the two is lost, since when, and what is done. */
  _strip() {
    const { lost, silent, link, hello } = this;
    const strip = byId("connection");
    strip.hidden = !lost && !silent;
    if (lost) {
      const since = this.heard_at ? ` The last frame came at ${this.heard_at.toLocaleTimeString()}; all that is shown is of then.` : "";
      const why = this.connection.reason ? ` (${this.connection.reason})` : "";
      tell(byId("connection-words"), this.connection.accepted ? `mavsentry is getting ready: it has nothing to say yet.${since}`
        : hello || this.connection.failures ? `No connection to mavsentry${why}.${since} Trying again.`
        : "Connecting to mavsentry …");
    } else if (silent) {
      const never = !link || link.silent_s === null;
      tell(byId("connection-words"), never
        ? `Waiting for the vehicle: nothing has been heard on ${hello?.source ?? "the link"} yet. mavsentry itself answers.`
        : `The vehicle is silent: nothing for ${ago(link.silent_s)}; all that is shown is of then. mavsentry itself answers.`);
    }
    const state = lost ? (this.connection.accepted ? "… getting ready" : "✕ no connection") : silent ? "… vehicle silent" : `● live, ${Math.round(this.rate())} Hz`;
    tell(byId("live"), state);
  }

  _outdated() {
    this.connection.reason = "the daemon is of another version: reload this page";
    this.connection.socket.close();
  }

  _sound(pressing, lost) {
    const now = new Set([...pressing.map(({ name }) => name), ...(lost ? ["connection"] : [])]);
    const fresh = [...now].some((name) => !this.sounded.has(name));
    this.sounded = now;
    if (fresh && this.audio) beep(this.audio);
  }

  pause(on) {
    this.view.paused_s = on ? this.store.t_s : null;
    const button = byId("pause");
    button.setAttribute("aria-pressed", String(this.view.paused_s !== null));
    tell(button.querySelector("span"), this.view.paused_s !== null ? "Resume" : "Pause");
    this.painter.ask();
    this.show();
  }

  window(seconds) {
    this.view.window_s = seconds;
    for (const input of document.querySelectorAll("input[name=window]")) input.checked = Number(input.value) === seconds;
    for (const figure of this.painter.figures) figure.drawn_ms = -Infinity;
    this.painter.ask();
  }

  _controls() {
    byId("pause").addEventListener("click", () => this.pause(this.view.paused_s === null));
    for (const input of document.querySelectorAll("input[name=window]")) {
      input.addEventListener("change", () => this.window(Number(input.value)));
    }
    byId("sound").addEventListener("change", ({ target }) => {
      this.audio?.close();
      this.audio = target.checked ? new AudioContext() : null;
      if (this.audio) beep(this.audio);  // so that one knows how loud it is
    });
    const keys = {
      p: () => byId("pause").click(), d: () => document.querySelector("[data-switch-theme]").click(), s: () => byId("sound").click(),
      1: () => this.window(60), 2: () => this.window(120), 5: () => this.window(300),
    };
    document.addEventListener("keydown", (event) => {
      const typing = event.target.closest?.("textarea, select, input:not([type=radio]):not([type=checkbox])");
      if (typing || event.ctrlKey || event.altKey || event.metaKey) return;
      keys[event.key.toLowerCase()]?.();
    });
  }
}

const beep = (audio) => {
  for (const [at, pitch] of [[0, 880], [0.22, 660]]) {
    const tone = new OscillatorNode(audio, { frequency: pitch });
    const gain = new GainNode(audio, { gain: 0.2 });
    tone.connect(gain).connect(audio.destination);
    tone.start(audio.currentTime + at);
    tone.stop(audio.currentTime + at + 0.18);
  }
};

/** Beside the page; a token, where one is needed, is in a cookie. */
const address = () => {
  const url = new URL("live", location.href);
  url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  url.hash = "";
  return url;
};

Bokeh.set_log_level("warn");
const app = new App(JSON.parse(byId("catalogue").textContent));
