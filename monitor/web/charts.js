"use strict";
// Bokeh figures, made in Python, filled from the store. One figure is drawn at a time, those that
// are on the screen in turn, and after each the page rests three times as long as it took.

const REDRAW_MS = 200;    // a figure is drawn five times a second at most
const TIMELINE_MS = 500;
const TAPPED_MS = 8000;  // a finger that points does not leave: its reading ends after this
const REST = 3;           // resting time over drawing time: drawing has a quarter of the thread
const BUCKET_PX = 2;

const minutes = (seconds) => {
  const whole = Math.round(Math.abs(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (n) => String(n).padStart(2, "0");
  return (seconds <= -0.5 ? "−" : "") + (h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`);
};

const digits = (value) => {
  const size = Math.abs(value);
  const shown = value.toFixed(size >= 999.5 ? 0 : size >= 99.95 ? 1 : 2);
  return (/^-0\.?0*$/.test(shown) ? shown.slice(1) : shown).replace("-", "−");
};

const make = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") element.className = value; else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
};

/** Set a text only where it differs: an unchanged page is neither laid out nor read aloud anew. */
const tell = (element, text) => { if (element.textContent !== text) element.textContent = text; };

/** A figure of the catalogue in its place on the page. */
class Figure {
  constructor(spec) {
    this.spec = spec;
    this.seen = false;
    this.drawn_ms = -Infinity;
    this.plot = null;
    this.period_ms = REDRAW_MS;
    this.target = make("div", { class: "plot", id: `plot-${spec.key}`, role: "img", "aria-label": spec.about });
  }

  async open() {
    const views = await Bokeh.embed.embed_item(this.spec.item, this.target.id);
    this.plot = views.roots[0].model;
    this.doc = this.plot.document;
    for (const name of ["mousemove", "tap"]) this.plot.on_event(name, (event) => this.point(event));
    this.plot.on_event("mouseleave", () => this.point(null));
    Theme.follow(this.doc);
    this.drawn_ms = -Infinity;
  }

  /** Put the axis where the window is; its end is called `now` only while it is. */
  frame({ window_s, end }) {
    if (this.window_s === window_s && this.end === end) return;
    Object.assign(this, { window_s, end });
    const [axis] = this.plot.below;
    axis.major_label_overrides = new Map([...axis.major_label_overrides].map(([at, word]) => [at, Number(at) === 0 ? end : word]));
    this.plot.x_range.setv({ start: -window_s, end: 0 });
    const step = window_s <= 60 ? 10 : window_s <= 120 ? 30 : 60;
    const ticks = [];
    for (let t = -window_s; t <= 0; t += step) ticks.push(t);
    axis.ticker.ticks = ticks;
  }
}

/** Lines over time, with a key that tells their values: now, or where the pointer is. */
class LineChart extends Figure {
  constructor(spec) {
    super(spec);
    this.at_s = null;
    this.keys = new Map();
    const key = make("ul", { class: "key" });
    for (const one of spec.series) {
      const value = make("b");
      const item = make("li", { hidden: "" }, make("i", { class: `stroke ${one.look} ${one.tone}` }), `${one.label} `, value);
      key.append(item);
      this.keys.set(one, { item, value });
    }
    this.when = make("span", { class: "when soft" });
    const head = make("h3", {}, spec.title, " ", make("small", {}, spec.unit), " ", this.when);
    this.element = make("section", { class: "chart", id: `chart-${spec.key}`, "data-key": spec.key }, head, key, this.target);
  }

  static needed(spec, store) { return spec.series.some((one) => store.columns.has(one.column)); }

  point(event) {
    const x = event?.x;
    this.at_s = x === undefined || x < -this.window_s || x > 0 ? null : x;
    clearTimeout(this.left);
    if (event?.event_name === "tap") this.left = setTimeout(() => this.point(null), TAPPED_MS);
    this.element.dispatchEvent(new Event("pointed", { bubbles: true }));
  }

  draw(store, view) {
    this.frame(view);
    const buckets = Math.min(400, Math.max(60, Math.round(this.target.clientWidth / BUCKET_PX)));
    const got = drawn(store, this.spec.series, view.to_s, view.window_s, buckets);
    const range = this.spec.log ? this._decades(got) : this._nice(got);
    if (range) this.plot.y_range.setv({ start: range[0], end: range[1] });
    if (this.spec.log) for (const { column } of this.spec.series) clip(got.data[column], this.spec.floor);
    for (const renderer of this.plot.renderers) {
      const has = store.columns.has(renderer.name);
      if (renderer.visible !== has) renderer.visible = has;
    }
    this.doc.get_model_by_name("rows").data = got.data;
  }

  /** The values beside the names; `stale` shows none: an old number is no value. */
  tell(store, view, stale) {
    const at_s = this.at_s === null ? view.to_s : view.to_s + this.at_s;
    tell(this.when, this.at_s === null ? "" : `${minutes(this.at_s)} (${minutes(at_s)})`);
    for (const [one, { item, value }] of this.keys) {
      item.hidden = !store.columns.has(one.column);
      if (item.hidden) continue;
      const got = stale && this.at_s === null ? null : store.at(one.column, at_s);
      const std = got && one.std ? store.at(one.std, at_s) : null;
      const middle = got && (got[0] + got[1]) / 2;
      tell(value, got ? digits(middle) + (std ? ` ± ${digits(2 * std[0])}` : "") : "–");
    }
  }

  /** Round bounds that hold all values and, as far as it leaves them readable, their bands. */
  _nice({ low, high, edge_low, edge_high }) {
    const { least } = this.spec;
    if (low > high) return null;
    const room = 0.75 * Math.max(high - low, least);
    low = Math.min(low, Math.max(edge_low, low - room));
    high = Math.max(high, Math.min(edge_high, high + room));
    if (high - low < least) [low, high] = [(low + high - least) / 2, (low + high + least) / 2];
    const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
    const wanted = [Math.floor(low / step + 1e-6) * step, Math.ceil(high / step - 1e-6) * step];
    const now = this.bounds;
    const fits = now && now[0] <= low && now[1] >= high && now[1] - now[0] <= 2.2 * (wanted[1] - wanted[0]);
    return fits ? null : (this.bounds = wanted);
  }

  _decades({ high }) {
    const top = Math.max(10, 10 ** Math.ceil(Math.log10(Math.max(high, 1)) + 0.1));
    if (this.bounds && (top === this.bounds[1] || (top < this.bounds[1] && high > 0.1 * top))) return null;
    return (this.bounds = [this.spec.floor, top]);
  }
}

const clip = (values, floor) => {
  for (let i = 0; i < values.length; i++) if (values[i] < floor) values[i] = floor;
};

/** The states of all sensors over the window. */
class TimelineChart extends Figure {
  constructor(spec) {
    super(spec);
    this.period_ms = TIMELINE_MS;
    this.sensors = [];
    this.spans = new Map();  // sensor -> standings, oldest first
    this.readout = make("p", { class: "readout soft", id: "timeline-readout" });
    this.element = make("div", { class: "timeline" }, this.target, this.readout);
    this.hint = "Point at a bar or tap it: what was said, and why.";
    tell(this.readout, this.hint);
  }

  clear() {
    this.spans.clear();
  }

  /** Take new standings of a sensor; those that ended before the longest window are let go. */
  take(sensor, standings, keep_from_s) {
    let spans = this.spans.get(sensor);
    if (!spans) {
      spans = [];
      this.spans.set(sensor, spans);
    }
    for (const one of standings) {
      const last = spans.at(-1);
      if (!last || one.t_s >= last.t_s) spans.push(one);
    }
    while (spans.length > 1 && spans[1].t_s < keep_from_s) spans.shift();
  }

  /** A row for each sensor; where there are as many as before it costs nothing. */
  _rows() {
    if (this.sensors.length === this.spans.size && this.sensors.every((sensor) => this.spans.has(sensor))) return;
    this.sensors = [...this.spans.keys()].sort(bySensor);
    this.plot.y_range.factors = [...this.sensors].reverse();
    this.plot.height = Math.max(2, this.sensors.length) * this.spec.row_px + this.spec.axis_px;
  }

  draw(store, view) {
    this.frame(view);
    this._rows();
    const rows = new Map(this.spec.states.map((state) => [state, { sensor: [], left: [], right: [] }]));
    for (const [sensor, spans] of this.spans) {
      spans.forEach((one, i) => {
        const left = Math.max(one.t_s - view.to_s, -view.window_s);
        const right = Math.min(i + 1 < spans.length ? spans[i + 1].t_s - view.to_s : 0, 0);
        const into = rows.get(one.state);
        if (right <= left || !into) return;
        into.sensor.push(sensor); into.left.push(left); into.right.push(right);
      });
    }
    for (const [state, data] of rows) {
      const source = this.doc.get_model_by_name(`state-${state}`);
      if (data.sensor.length || source.get_length()) source.data = data;
    }
    this.view = { ...view };
  }

  point(event) {
    const sensor = event && this.sensors[this.sensors.length - 1 - Math.floor(event.y)];
    if (!sensor || !this.view || event.x < -this.view.window_s || event.x > 0) return tell(this.readout, this.hint);
    const t_s = this.view.to_s + event.x;
    const one = this.spans.get(sensor).findLast((span) => span.t_s <= t_s);
    const what = one ? [this.spec.words[one.state], whyOf(one)].filter(Boolean).join(": ") : "not known";
    tell(this.readout, `${sensor}, ${minutes(event.x)} (${minutes(t_s)}): ${what}`);
  }
}

const pretty = (text) => text.replaceAll("m/s^2", "m/s²");

/** What stands beside a state: the fault's size and evidence, or the reason. */
const whyOf = (one) => {
  if (one.state !== "faulty") return pretty(one.reason ?? one.evidence ?? "");
  const shape = one.kind && one.kind !== "unknown" && one.kind !== one.size ? `, ${one.kind}` : "";
  return pretty(`${one.size ?? ""}${shape}${one.evidence ? `: ${one.evidence}` : ""}`);
};

const FAMILIES = ["imu", "airspeed", "aoa", "spool", "engine", "wing", "gps", "attitude"];
const bySensor = (a, b) => {
  const family = (name) => { const at = FAMILIES.findIndex((f) => name.startsWith(f)); return at < 0 ? 99 : at; };
  return family(a) - family(b) || a.localeCompare(b, "en", { numeric: true });
};

/** Draws what is on the screen, one figure at a time. */
class Painter {
  /** @param {() => {store: Store, view: object}} look what to draw now */
  constructor(look) {
    this.look = look;
    this.figures = new Set();
    this.asked = 0;
    this.spent_ms = 0;
    this.on_screen = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        for (const figure of this.figures) if (figure.target === target) figure.seen = isIntersecting;
      }
      this.ask();
    }, { rootMargin: "80px" });
    void this._run();
  }

  add(figure) { this.figures.add(figure); this.on_screen.observe(figure.target); }

  /** There is something new to draw. */
  ask() { this.asked += 1; this.wake?.(); }

  async _run() {
    let done = -1;
    for (;;) {
      if (done === this.asked || document.hidden) await new Promise((wake) => { this.wake = wake; });
      if (document.hidden) continue;
      done = this.asked;
      let due_ms = Infinity;  // when a figure that was drawn just now may be drawn again
      const round = [...this.figures].filter((f) => f.seen);
      for (const figure of round.sort((a, b) => a.drawn_ms - b.drawn_ms)) {
        const now = performance.now();
        const rest_ms = figure.drawn_ms + figure.period_ms - now;
        if (rest_ms > 0) { due_ms = Math.min(due_ms, rest_ms); continue; }
        figure.drawn_ms = now;
        const { store, view } = this.look();
        if (view.to_s === null) continue;
        let spent = 0;
        try {
          spent = await this._paint(() => figure.draw(store, view));
        } catch (error) {
          console.error(error);  // one figure that fails leaves the others drawn
        }
        this.spent_ms += spent;
        await new Promise((rested) => setTimeout(rested, Math.min(2000, REST * spent)));
      }
      if (due_ms < Infinity) {
        await new Promise((rested) => setTimeout(rested, due_ms));
        done = -1;
      }
    }
  }

  /** Draw, and tell how long the thread was busy with it [ms]: the call, then the next frame. */
  async _paint(draw) {
    const began = performance.now();
    draw();
    await null;
    const called = performance.now() - began;
    const painted = await new Promise((done) => {
      const late = setTimeout(() => done(0), 1000);
      requestAnimationFrame(() => {
        const frame = performance.now();
        setTimeout(() => { clearTimeout(late); done(performance.now() - frame); }, 0);
      });
    });
    return called + painted;
  }
}
