// What was painted: a rectangle and strokes, with undo. Lengths in px of the rectified picture.

const NOTHING = { rectangle: null, wanted: [], unwanted: [] };

/** A drawing that remembers what it was; `changed()` is called after each step. */
export class Strokes {
  #past = [];
  #now = NOTHING;

  constructor(changed) {
    this.changed = changed;
  }

  get now() {
    return this.#now;
  }

  get empty() {
    return !this.#now.rectangle && !this.#now.wanted.length && !this.#now.unwanted.length;
  }

  get canUndo() {
    return this.#past.length > 0;
  }

  setRectangle(rectangle) {
    this.#step({ ...this.#now, rectangle });
  }

  /** `kind` is wanted or unwanted. */
  addStroke(kind, stroke) {
    this.#step({ ...this.#now, [kind]: [...this.#now[kind], stroke] });
  }

  clear() {
    if (!this.empty) this.#step(NOTHING);
  }

  undo() {
    if (!this.canUndo) return;
    this.#now = this.#past.pop();
    this.changed();
  }

  #step(next) {
    this.#past.push(this.#now);
    this.#now = next;
    this.changed();
  }
}

/**
 * A rectangle [x, y, width, height] of whole pixels between two places, inside a picture of `size` [width, height];
 * null if it is too small.
 */
export function rectangleBetween([x0, y0], [x1, y1], [width, height]) {
  // A pixel begins half a pixel before its centre.
  const within = (value, most) => Math.min(most, Math.max(0, Math.round(value + 0.5)));
  const left = within(Math.min(x0, x1), width),
    right = within(Math.max(x0, x1), width);
  const top = within(Math.min(y0, y1), height),
    bottom = within(Math.max(y0, y1), height);
  return right - left >= 3 && bottom - top >= 3 ? [left, top, right - left, bottom - top] : null;
}

/** Add a place to a stroke unless the brush has hardly moved: a long stroke stays a short list. */
export function extend(stroke, [x, y]) {
  const last = stroke.points.at(-1);
  if (last && Math.hypot(x - last[0], y - last[1]) < Math.max(1, stroke.radius / 4)) return;
  stroke.points.push([Math.round(10 * x) / 10, Math.round(10 * y) / 10]);
}
