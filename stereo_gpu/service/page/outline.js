// The outline of what was painted, as the service finds it: one request at a time, and always for the newest strokes.

import { body, persist, send } from "./api.js";

/** Ask for the rectified view of a pair; returns {id, width, height, bitmap}. */
export async function openOutline({ left, right, rig, reference }, signal) {
  const form = new FormData();
  form.append("left", left, left.name);
  form.append("right", right, right.name);
  form.append("rig", rig);
  if (reference !== "right") form.append("reference", reference);
  return persist(async () => {
    const outline = await body(await send("/v1/outlines", { method: "POST", body: form, signal }), "json", signal);
    const view = await body(await send(outline.picture, { signal }), "blob", signal);
    return { ...outline, bitmap: await createImageBitmap(view) };
  }, signal);
}

/** Keeps the mask of an outline up to date: `changed({mask, bitmap, error, busy})` is told of each step. */
export class OutlineMask {
  #asked = 0;
  #running = false;
  #newest = null;
  #settled = Promise.resolve();

  constructor(id, changed, signal) {
    Object.assign(this, { id, changed, signal });
  }

  /** Ask for the mask of what is painted now; an older question that still runs is not shown. */
  ask(painted) {
    this.#newest = painted;
    this.#asked++;
    if (!this.#running) this.#settled = this.#run();
  }

  /** Ends when the newest strokes have their mask, or an error. */
  settled() {
    return this.#settled;
  }

  async #run() {
    this.#running = true;
    for (let answered = -1; answered !== this.#asked && !this.signal.aborted;) {
      answered = this.#asked;
      const painted = this.#newest;
      let state = { mask: null, bitmap: null, error: "", busy: false };
      try {
        if (painted) {
          this.changed({ busy: true });
          const mask = await persist(() => this.#fetch(painted), this.signal);
          state = { ...state, mask, bitmap: await createImageBitmap(mask) };
        }
      } catch (error) {
        state.error = error.message;
        state.gone = error.status === 404;
      }
      if (answered === this.#asked && !this.signal.aborted) this.changed(state);
    }
    this.#running = false;
  }

  async #fetch(painted) {
    const answer = await send(`/v1/outlines/${this.id}/mask`, {
      method: "POST",
      body: JSON.stringify(painted),
      signal: this.signal,
      headers: { "Content-Type": "application/json" },
    });
    return body(answer, "blob", this.signal);
  }
}
