// Columns of the pictures as they come, by stream time; see radard/web/pictures/wire.py for the bytes.

const SLOTS = 1500;
const HEAD_BYTES = 24;
export const MISSING = 0;
export const LOST = 1;
export const GOOD = 2;

export class Pictures {
  constructor(slots = SLOTS) {
    this.slots = slots;
    this.axes = null;
    this.version = 0;
    this.gait = null;
    this.clear();
  }

  clear() {
    this.newest = -1;
    this.oldest = 0;
    this.epoch = -1;
    this.state = new Uint8Array(this.slots);
    this.gait = null;
    this.version += 1;
  }

  setAxes(axes) {
    this.axes = axes;
    this.by = new Map(axes.pictures.map((picture) => [picture.name, picture]));
    this.timed = axes.pictures.filter((picture) => picture.name !== "gait");
    this.data = new Map(
      this.timed.map((picture) => [picture.name, new Uint8Array(this.slots * picture.n_rows)]),
    );
    this.clear();
  }

  get end_s() {
    return this.newest < 0 ? null : this.newest * this.axes.column_s;
  }

  take(buffer) {
    if (!this.axes) return;
    const view = new DataView(buffer);
    const kind = view.getUint8(0);
    if (kind === 1) this.#takeColumns(buffer, view);
    else if (kind === 2) this.#takeGait(buffer, view);
  }

  #takeColumns(buffer, view) {
    const n = view.getUint16(2, true);
    const epoch = view.getUint32(8, true);
    const end = Math.round(view.getFloat64(16, true) / this.axes.column_s);
    const first = end - n + 1;
    if (this.newest >= 0 && (first < this.newest - 3 || first > this.newest + this.slots)) this.clear();
    this.epoch = epoch;
    if (this.newest < 0) {
      this.newest = first - 1;
      this.oldest = first;
    }
    const flags = new Uint8Array(buffer, HEAD_BYTES, n);
    for (let slot = this.newest + 1; slot < first; slot += 1) this.state[slot % this.slots] = MISSING;
    let at = HEAD_BYTES + n;
    for (const { name, n_rows } of this.timed) {
      const data = this.data.get(name);
      for (let k = 0; k < n; k += 1) {
        const column = new Uint8Array(buffer, at + k * n_rows, n_rows);
        data.set(column, ((first + k) % this.slots) * n_rows);
      }
      at += n * n_rows;
    }
    for (let k = 0; k < n; k += 1) this.state[(first + k) % this.slots] = flags[k] ? GOOD : LOST;
    this.newest = Math.max(this.newest, end);
    this.oldest = Math.max(this.oldest, this.newest - this.slots + 1);
  }

  #takeGait(buffer, view) {
    const n = view.getUint16(2, true);
    const rows = view.getUint32(4, true);
    this.gait = { n, rows, values: new Uint8Array(buffer, HEAD_BYTES, n * rows), t_s: view.getFloat64(16, true), atMs: performance.now() };
  }

  // Value (0 to 255) of a cell, or null where nothing is known.
  value(name, slot, row) {
    if (slot < this.oldest || slot > this.newest) return null;
    if (this.state[slot % this.slots] === MISSING) return null;
    const { n_rows } = this.by.get(name);
    return this.data.get(name)[(slot % this.slots) * n_rows + row];
  }

  // The last column that is known, or null.
  lastColumn(name) {
    if (this.newest < 0 || this.state[this.newest % this.slots] === MISSING) return null;
    const { n_rows } = this.by.get(name);
    const at = (this.newest % this.slots) * n_rows;
    return this.data.get(name).subarray(at, at + n_rows);
  }

  covers(from_s, to_s) {
    if (this.newest < 0) return false;
    const { column_s } = this.axes;
    return from_s / column_s >= this.oldest - 1 && to_s / column_s <= this.newest + 8;
  }

  // A copy of some seconds, which stays as it is.
  frozen(from_s, to_s) {
    const { column_s } = this.axes;
    const first = Math.max(this.oldest, Math.floor(from_s / column_s));
    const last = Math.min(this.newest, Math.ceil(to_s / column_s));
    const n = Math.max(1, last - first + 1);
    const copy = new Pictures(n);
    copy.setAxes(this.axes);
    copy.oldest = first;
    copy.newest = last;
    for (let slot = first; slot <= last; slot += 1) {
      copy.state[slot % n] = this.state[slot % this.slots];
      for (const { name, n_rows } of this.timed) {
        const at = (slot % this.slots) * n_rows;
        copy.data.get(name).set(this.data.get(name).subarray(at, at + n_rows), (slot % n) * n_rows);
      }
    }
    return copy;
  }

  // Pictures of a clip, see radard/web/pictures/clip_view.py.
  static ofClip(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const rest = buffer.slice(4 + length);
    const slots = Math.ceil(head.length_s / head.axes.column_s) + 2;
    const made = new Pictures(slots);
    made.setAxes(head.axes);
    if (rest.byteLength > HEAD_BYTES) made.take(rest);
    return { pictures: made, ...head };
  }
}
