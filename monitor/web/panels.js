"use strict";
// The words of the page: what is wrong, the state of every sensor, the link, the recorder.

const PRESSING = ["faulty", "stopped", "stale", "suspect"];
const AXES = ["acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z"];
const byId = (id) => document.getElementById(id);
const thousands = (n) => Math.round(n).toLocaleString("en");
const plural = (n, one) => `${thousands(n)} ${one}${n === 1 ? "" : "s"}`;

const bytes = (n) => n < 1e3 ? `${n} B` : n < 1e6 ? `${(n / 1e3).toFixed(0)} kB`
  : n < 1e9 ? `${(n / 1e6).toFixed(1)} MB` : `${(n / 1e9).toFixed(2)} GB`;

/** How long ago, in words short enough to stand in a line. */
const ago = (seconds) => seconds < 99.5 ? `${Math.max(0, Math.round(seconds))} s`
  : seconds < 5940 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;

/** What stands for a sensor where all of its group are in one state: an IMU for its axes, the wings. */
function groupOf(sensor, standing) {
  const [name, part] = sensor.split(".");
  if (AXES.includes(part)) return [name, AXES.map((axis) => `${name}.${axis}`)];
  if (name.startsWith("wing_")) return ["wings", [...standing.keys()].filter((one) => one.startsWith("wing_"))];
  return [sensor, [sensor]];
}

/** Sensors by name; those of a group that are in one state for one reason are a single entry. */
function grouped(standing) {
  const out = new Map();
  for (const sensor of [...standing.keys()].sort(bySensor)) {
    const one = standing.get(sensor);
    const [name, sensors] = groupOf(sensor, standing);
    const all = sensors.map((other) => standing.get(other));
    const alike = (other) => other && other.state === one.state && (other.reason ?? "") === (one.reason ?? "");
    if (sensors.length === 1 || one.state === "faulty" || !all.every(alike)) out.set(sensor, { one, sensors: [sensor] });
    else if (!out.has(name)) out.set(name, { one: all.reduce((a, b) => (b.t_s > a.t_s ? b : a)), sensors });
  }
  return out;
}

/** Names in a line: `airspeed0, airspeed1, airspeed2` is `airspeed0–2`. */
function listed(names) {
  const runs = [];
  for (const name of names) {
    const [, stem, number] = /^(.*?)(\d*)$/.exec(name);
    const last = runs.at(-1);
    if (last && number && last.stem === stem && Number(number) === last.to + 1) last.to += 1;
    else runs.push({ stem, name, to: Number(number) });
  }
  return runs.map(({ stem, name, to }) => (name.endsWith(String(to)) || name === stem ? name : `${name}–${to}`)).join(", ");
}

/** Keep the children of an element in step with keys, without making anew what stays. */
function keep(parent, keys, build) {
  const there = new Map([...parent.children].map((child) => [child.dataset.key, child]));
  let at = parent.firstElementChild;
  for (const key of keys) {
    let child = there.get(key);
    if (!child) { child = build(key); child.dataset.key = key; }
    there.delete(key);
    if (child === at) at = at.nextElementSibling; else parent.insertBefore(child, at);
  }
  for (const child of there.values()) child.remove();
}

const cell = (row, name) => row.querySelector(`[data-of="${name}"]`);

/** A table without rows is not shown; that there is nothing, is said. */
function none(id, is) {
  byId(`${id}-none`).hidden = !is;
  byId(id).closest(".scroll").hidden = is;
}

/** The state's mark on its colour. */
function mark(element, state, look) {
  const swatch = element.querySelector(".swatch");
  if (swatch.dataset.state === state) return;
  swatch.dataset.state = state;
  swatch.className = `swatch ${state}`;
  swatch.textContent = look.mark;
}

/** What presses, what is judged: the banner, the title and what is read aloud. */
class Banner {
  constructor(looks) {
    this.looks = looks;
    this.spoken = "";
  }

  /** @returns {{level: string, title: string, said: string, lines: object[], fine: string, idle: string, calm: string}} */
  static digest(standing, looks) {
    const groups = [...grouped(standing)].filter(([, { one }]) => one.state !== "absent");
    const pressing = groups.filter(([, { one }]) => PRESSING.includes(one.state))
      .sort(([, a], [, b]) => PRESSING.indexOf(a.one.state) - PRESSING.indexOf(b.one.state) || a.one.t_s - b.one.t_s);
    const lines = pressing.map(([name, { one }]) => ({ name, one, state: one.state }));
    const level = lines.length ? lines[0].state : null;
    const said = lines.filter(({ state }) => state !== "suspect")
      .map(({ name, one }) => `${name} ${looks[one.state].word}. ${whyOf(one)}`);
    const title = lines.length ? `${looks[level].mark} ${lines[0].name} ${looks[level].word}`
      + (lines.length > 1 ? ` and ${lines.length - 1} more` : "") : null;
    return { level, title, said: said.join(" "), lines, ...Banner._rest(groups) };
  }

  /** What does not press: what is fine, and what is not judged, by reason. */
  static _rest(groups) {
    const names = (state, reason) => listed(groups.filter(([, { one }]) => one.state === state
      && (reason === undefined || one.reason === reason)).map(([name]) => name));
    const ok = names("ok");
    const reasons = [...new Set(groups.filter(([, { one }]) => one.state === "unmonitored").map(([, { one }]) => one.reason))];
    const idle = reasons.map((reason) => `${names("unmonitored", reason)}${reason ? ` – ${reason}` : ""}`);
    if (!groups.length) return { fine: "No sensor has been heard yet.", idle: "", calm: "unmonitored" };
    return {
      fine: ok ? `✓ ok: ${ok}` : "", idle: idle.length ? `○ not judged: ${idle.join("; ")}` : "", calm: ok ? "ok" : "unmonitored",
    };
  }

  show(digest, t_s, recorder) {
    const box = byId("alarm");
    box.dataset.state = digest.level ?? digest.calm;
    keep(byId("alarm-lines"), digest.lines.map(({ name }) => name), () => make("li", {},
      make("i", { class: "swatch", "aria-hidden": "true" }), make("strong"), " ",
      make("span", { "data-of": "what" }), " ", make("span", { "data-of": "since", class: "since" }),
      make("span", { "data-of": "why", class: "why" })));
    digest.lines.forEach(({ name, one, state }, i) => {
      const line = byId("alarm-lines").children[i], look = this.looks[state];
      mark(line, state, look);
      tell(line.querySelector("strong"), `${name} ${state === "suspect" ? look.word : look.word.toUpperCase()}`);
      const shape = one.kind && one.kind !== "unknown" && one.kind !== one.size ? `, ${one.kind}` : "";
      tell(cell(line, "what"), state === "faulty" ? pretty(`${one.size ?? ""}${shape}`) : "");
      const since_s = one.onset_t_s ?? one.t_s;
      tell(cell(line, "since"), t_s === null ? "" : `since ${minutes(since_s)} (${ago(t_s - since_s)} ago)`);
      tell(cell(line, "why"), pretty(one.evidence || one.reason || ""));
    });
    const [beside, fine, idle] = byId("alarm-rest").children;
    tell(beside, recorder?.stopped ? `! Not recording any more: ${recorder.stopped}` : "");
    tell(fine, digest.fine);
    tell(idle, digest.idle);
  }

  /** Say aloud what is new, once. */
  speak(text) {
    if (text === this.spoken) return;
    this.spoken = text;
    tell(byId("spoken"), text);
  }
}

/** The table of states, with what each sensor reads and how near its test is to its threshold. */
class StateTable {
  constructor(looks) { this.looks = looks; }

  show(standing, store, channels, stale) {
    const groups = grouped(standing);
    const shown = [...groups].filter(([, { one }]) => one.state !== "absent");
    const absent = [...groups].filter(([, { one }]) => one.state === "absent").map(([name]) => name);
    keep(byId("states"), shown.map(([name]) => name), (name) => make("tr", {},
      make("th", { scope: "row" }, name), make("td", { "data-of": "state" }, make("i", { class: "swatch", "aria-hidden": "true" }), make("span", { "data-of": "word" })),
      make("td", { "data-of": "since", class: "n" }), make("td", { "data-of": "now", class: "n live" }),
      make("td", { "data-of": "test", class: "n live" }), make("td", { "data-of": "why", class: "why" })));
    shown.forEach(([name, { one, sensors }], i) => {
      const row = byId("states").children[i], look = this.looks[one.state];
      mark(row, one.state, look);
      tell(cell(row, "word"), look.word);
      tell(cell(row, "since"), minutes(one.onset_t_s ?? one.t_s));
      tell(cell(row, "why"), whyOf(one));
      tell(cell(row, "now"), sensors.length > 1 || stale ? "" : this._now(name, store, channels));
      const ratios = sensors.map((s) => this._fresh(store, `${s}.test`)).filter((v) => v !== null);
      const ratio = ratios.length && !stale ? Math.max(...ratios) : null;
      tell(cell(row, "test"), ratio === null ? "" : digits(ratio));
      cell(row, "test").classList.toggle("over", ratio !== null && ratio > 1);
    });
    const not = byId("absent");
    not.hidden = !absent.length;
    tell(not, absent.length ? `Not fitted: ${absent.join(", ")}.` : "");
  }

  _fresh(store, name) {
    const got = store.newest.get(name);
    return got && store.t_s - got[0] <= HOLD_S ? (got[1] + got[2]) / 2 : null;
  }

  _now(name, store, channels) {
    const value = this._fresh(store, name);
    return value === null ? "" : `${digits(value)} ${unitOf(channels[name])}`;
  }
}

const unitOf = (unit) => pretty((unit ?? "").replace("deg", "°"));

/** Link, latency, recorder, daemon, streams, rejections, faults so far. */
class Facts {
  show(app) {
    const { link, latency, recorder, process, hello } = app;
    if (hello) {
      tell(byId("about"), `${hello.source} · profile ${hello.profile} · mavsentry ${hello.version} · up since ${new Date(hello.started_unix_s * 1e3).toLocaleString()}`);
    }
    this._list("link-facts", link ? {
      "datagrams": `${digits(link.datagrams_s)} /s`, "samples": `${digits(link.rows_s)} /s`,
      "received": bytes(link.bytes), "bad bytes": bytes(link.bad_bytes), "frames lost": thousands(link.lost),
      "published": plural(link.sent, "message"),
    } : {});
    const ms = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(1)} ms`);
    this._list("latency-facts", latency ? {
      "median": ms(latency.median_ms), "99 %": ms(latency.p99_ms), "worst": ms(latency.worst_ms), "answers": thousands(latency.count),
    } : {});
    this._list("recorder-facts", recorder === undefined ? {} : recorder === null ? { "recorder": "off (--record DIR)" } : {
      "file": recorder.file, "size": bytes(recorder.file_bytes), "all files": bytes(recorder.bytes),
      "state": recorder.stopped ? `STOPPED: ${recorder.stopped}` : "recording",
    });
    byId("recorder-facts").classList.toggle("bad", Boolean(recorder?.stopped));
    this._list("daemon-facts", {
      ...(process ? { "processor time": `${process.cpu_s.toFixed(1)} s`, "memory": process.memory_mb === null ? "–" : `${process.memory_mb.toFixed(0)} MB`,
        "cost of a frame": ms(process.snapshot_ms), "frames dropped": thousands(process.dropped) } : {}),
      "this page": `${app.rate().toFixed(1)} frames/s${app.missed ? `, ${thousands(app.missed)} missed` : ""}`,
    });
    this._streams(app.streams ?? {});
    this._rejected(app.rejected ?? {});
    this._faults([...app.faults.values()].reverse(), [...app.events.values()].reverse(), app.store.t_s);
  }

  _list(id, facts) {
    const list = byId(id);
    keep(list, Object.keys(facts), (name) => make("div", {}, make("dt", {}, name), make("dd")));
    Object.values(facts).forEach((value, i) => tell(list.children[i].lastElementChild, value));
  }

  _rows(id, rows, columns) {
    const body = byId(id);
    keep(body, rows.map(([key]) => key), () => {
      const row = make("tr");
      columns.forEach((kind, i) => row.append(i ? make("td", { class: kind }) : make("th", { scope: "row" })));
      return row;
    });
    rows.forEach(([, ...texts], r) => texts.forEach((text, i) => tell(body.children[r].children[i], text)));
  }

  _streams(streams) {
    const names = Object.keys(streams).sort(bySensor);
    this._rows("streams", names.map((name) => {
      const { rate_hz, samples, gaps, stale } = streams[name];
      return [name, name, digits(rate_hz), thousands(samples), thousands(gaps), stale ? "… stopped" : ""];
    }), ["", "n live", "n", "n", "warn"]);
  }

  _rejected(rejected) {
    const rows = Object.entries(rejected).flatMap(([sensor, reasons]) =>
      Object.entries(reasons).map(([reason, count]) => [`${sensor}/${reason}`, sensor, reason, thousands(count)]));
    this._rows("rejected", rows.sort(([a], [b]) => bySensor(a, b)), ["", "", "n"]);
    none("rejected", !rows.length);
  }

  _faults(faults, events, t_s) {
    const rows = faults.map((f) => [`f${f.number}`, f.sensor, [pretty(f.size), f.kind === "unknown" || f.kind === f.size ? "" : f.kind].filter(Boolean).join(", "), minutes(f.onset_t_s),
      `${(f.isolated_t_s - f.onset_t_s).toFixed(1)} s`, f.cleared_t_s === null ? "stands" : minutes(f.cleared_t_s), pretty(f.evidence)]);
    const others = events.map((e) => [`e${e.number}`, e.what, e.state, minutes(e.onset_t_s), `${(e.detected_t_s - e.onset_t_s).toFixed(1)} s`,
      e.ended_t_s === null ? "stands" : minutes(e.ended_t_s), e.evidence]);
    this._rows("faults", [...rows, ...others], ["", "", "n", "n", "n", "why"]);
    none("faults", !rows.length && !others.length);
  }
}
