"use strict";
// What the page remembers: one row for each frame, in a ring that holds the longest window.

const UNSAID = NaN;        // the frame said nothing of this column
const UNKNOWN = Infinity;  // the frame said that it is not known (null)
const HOLD_S = 2.5;        // a value stands for so long when nothing newer is said; longer is a gap

/** Rows of named columns over vehicle time; each value is a range, low and high. */
class Store {
  /** @param {Set<string>} columns those that some chart draws; others are not kept */
  constructor(columns) {
    this.wanted = columns;
    this.absent = new Set();  // sensors that are not fitted: what stands in for their values is none
    this.clear(0);
  }

  /** Forget everything. @param {number} size rows to hold */
  clear(size) {
    this.size = Math.max(2, size);
    this.t = new Float64Array(this.size);
    this.columns = new Map();
    this.newest = new Map();  // every name -> [t, low, high], or null where it is not known
    this.written = 0;
    this.frame = -1;
  }

  /** A sensor is not fitted, or is after all. */
  fitted(sensor, is) {
    if (is) this.absent.delete(sensor);
    else { this.absent.add(sensor); this.columns.delete(sensor); this.newest.delete(sensor); }
  }

  get t_s() { return this.written ? this.t[(this.written - 1) % this.size] : null; }

  /** Take one frame, oldest first; one that was seen before is not taken again. */
  take(frame) {
    if (frame.number <= this.frame) return;
    this.frame = frame.number;
    if (frame.t_s === null) return;
    const before = this.t_s;
    if (before !== null && frame.t_s < before) this.clear(this.size);  // the vehicle's clock began anew
    this.frame = frame.number;
    if (before === null || frame.t_s !== before) this._open(frame.t_s);
    for (const [name, range] of Object.entries(frame.measured ?? {})) this._put(name, range[0], range[1]);
    for (const [name, ratio] of Object.entries(frame.tests ?? {})) this._put(`${name}.test`, ratio, ratio);
    for (const group of ["air", "engine", "wing"]) this._estimate(group, frame[group]);
    for (const [name, imu] of Object.entries(frame.imu ?? {})) this._estimate(name, imu);
  }

  _open(t_s) {
    const at = this.written % this.size;
    this.t[at] = t_s;
    for (const ring of this.columns.values()) ring.low[at] = ring.high[at] = UNSAID;
    this.written += 1;
  }

  _estimate(group, row) {
    if (!row) return;
    for (const [key, value] of Object.entries(row)) {
      if (Array.isArray(value)) value.forEach((v, i) => this._put(`${group}.${key}.${i}`, v, v));
      else this._put(`${group}.${key}`, value, value);
    }
  }

  _put(name, low, high) {
    if (this.absent.has(name)) return;
    this.newest.set(name, low === null ? null : [this.t_s, low, high]);
    if (!this.wanted.has(name)) return;
    let ring = this.columns.get(name);
    if (!ring) {
      if (low === null) return;  // a column begins with its first number
      ring = { low: new Float32Array(this.size).fill(UNSAID), high: new Float32Array(this.size).fill(UNSAID) };
      this.columns.set(name, ring);
    }
    const at = (this.written - 1) % this.size;
    const held = ring.low[at] === ring.low[at] && low !== null && ring.low[at] !== UNKNOWN;
    ring.low[at] = low === null ? UNKNOWN : held ? Math.min(ring.low[at], low) : low;
    ring.high[at] = high === null ? UNKNOWN : held ? Math.max(ring.high[at], high) : high;
  }

  /** Row numbers [first, end) of what lies within [from_s, to_s]. */
  rows(from_s, to_s) {
    let first = this._after(from_s, Math.max(0, this.written - this.size));
    let end = first;
    if (this.written && to_s >= this.t_s) end = this.written;
    else end = this._after(to_s, first);
    return [first, end];
  }

  /** The first row at or after a time, by halving: rows are in the order of time. */
  _after(t_s, low) {
    let high = this.written;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle % this.size] < t_s) low = middle + 1; else high = middle;
    }
    return low;
  }

  /** What a column says at a time: [low, high], or null. */
  at(name, t_s) {
    const ring = this.columns.get(name);
    if (!ring) return null;
    const [first, end] = this.rows(t_s - HOLD_S, t_s);
    for (let row = end - 1; row >= first; row--) {
      const low = ring.low[row % this.size];
      if (low === UNKNOWN) return null;
      if (low === low) return [low, ring.high[row % this.size]];
    }
    return null;
  }
}

/**
 * Series of a window for drawing: two points for each bucket of time that has rows, so that no peak
 * is lost, seconds before `to_s` as x. Buckets are anchored in time: only the newest one changes.
 *
 * @param {Store} store
 * @param {{column: string, std?: string}[]} series `std`: its one-sigma column; a band of two is made
 * @param {number} to_s @param {number} window_s @param {number} buckets
 * @returns {{data: Object<string, Float64Array>, low: number, high: number, edge_low: number, edge_high: number}}
 *   `low`, `high` of the values, `edge_*` of the bands; infinite where there are none
 */
function drawn(store, series, to_s, window_s, buckets) {
  const step = window_s / buckets;
  const [first, end] = store.rows(to_s - window_s, to_s);
  const starts = [];  // rows at which a bucket begins
  const gaps = [];    // buckets before which there is a gap
  for (let row = first, bucket = NaN, before = NaN; row < end; row++) {
    const t = store.t[row % store.size];
    const here = Math.floor(t / step);
    if (here !== bucket) {
      if (t - before > HOLD_S) gaps.push(starts.length);
      starts.push(row);
      bucket = here;
    }
    before = t;
  }
  const n = 2 * (starts.length + gaps.length);
  const x = new Float64Array(n);
  for (let b = 0, i = 0, g = 0; b < starts.length; b++) {
    const t = Math.max((Math.floor(store.t[starts[b] % store.size] / step) + 0.5) * step - to_s, -window_s);
    if (gaps[g] === b) { x[i] = i ? x[i - 1] : t; x[i + 1] = Math.min(t, 0); i += 2; g++; }
    x[i++] = Math.min(t, 0);
    x[i++] = Math.min(t, 0);
  }
  const out = { data: { x }, low: Infinity, high: -Infinity, edge_low: Infinity, edge_high: -Infinity };
  for (const one of series) _draw(store, one, starts, end, gaps, n, out);
  return out;
}

function _draw(store, { column, std }, starts, end, gaps, n, out) {
  const y = new Float64Array(n).fill(NaN);
  const below = std ? new Float64Array(n).fill(NaN) : null;
  const above = std ? new Float64Array(n).fill(NaN) : null;
  out.data[column] = y;
  if (std) { out.data[`${column}.low`] = below; out.data[`${column}.high`] = above; }
  const ring = store.columns.get(column);
  if (!ring) return;
  const sigma = std ? store.columns.get(std) : null;
  const { size, t } = store;
  let held_t = -Infinity, held = NaN, held_std = NaN;
  for (let b = 0, i = 0, g = 0; b < starts.length; b++) {
    if (gaps[g] === b) { i += 2; g++; held_t = -Infinity; }
    const stop = b + 1 < starts.length ? starts[b + 1] : end;
    let low = Infinity, high = -Infinity, lost = false, spread = -Infinity;
    for (let row = starts[b]; row < stop; row++) {
      const at = row % size, value = ring.low[at];
      if (value !== value) continue;
      lost = value === UNKNOWN;
      if (lost) continue;
      if (value < low) low = value;
      if (ring.high[at] > high) high = ring.high[at];
      if (sigma && sigma.low[at] < UNKNOWN && sigma.low[at] > spread) spread = sigma.low[at];
      held_t = t[at];
    }
    if (low <= high) {
      const upwards = !(Math.abs(held - low) > Math.abs(held - high));
      y[i] = upwards ? low : high;
      y[i + 1] = held = upwards ? high : low;
      held_std = spread >= 0 ? spread : NaN;
      if (low < out.low) out.low = low;
      if (high > out.high) out.high = high;
      if (lost) held_t = -Infinity;
    } else if (!lost && t[starts[b] % size] - held_t <= HOLD_S) {
      low = high = y[i] = y[i + 1] = held;
    } else { held_t = -Infinity; i += 2; continue; }
    if (std && held_std === held_std) {
      below[i] = below[i + 1] = low - 2 * held_std;
      above[i] = above[i + 1] = high + 2 * held_std;
      if (below[i] < out.edge_low) out.edge_low = below[i];
      if (above[i] > out.edge_high) out.edge_high = above[i];
    }
    i += 2;
  }
  if (std) _close(below, above);
}

/** Where a band is not known it has no height: Bokeh would draw it across, from what was to what will be. */
function _close(below, above) {
  const first = below.findIndex((v) => v === v);
  let middle = first < 0 ? NaN : (below[first] + above[first]) / 2;
  for (let i = 0; i < below.length; i++) {
    if (below[i] === below[i]) middle = (below[i] + above[i]) / 2;
    else below[i] = above[i] = middle;
  }
}
