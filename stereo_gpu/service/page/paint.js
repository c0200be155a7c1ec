// Paint what is wanted on the rectified picture, by pointer, finger or keys, and see its outline at once.

import { alertLine, button, field, make, say } from "./dom.js";
import { OutlineMask } from "./outline.js";
import { drawScene, maskPicture } from "./paint_drawing.js";
import { keyboard, pointer } from "./paint_hand.js";
import { extend, rectangleBetween, Strokes } from "./strokes.js";

const LARGEST = 1600; // px: what the drawing surface is cut to; strokes are kept in px of the picture itself
const SIDES = ["Left edge, px", "Top edge, px", "Width, px", "Height, px"];
const TOOLS = [
  ["rectangle", "Rectangle around it"],
  ["wanted", "Brush: wanted"],
  ["unwanted", "Brush: not wanted"],
];

/** A painter of one outline ({id, width, height, bitmap}); `mask()` gives the picture to send, or null. */
export function painter(outline, gone, signal) {
  const size = [outline.width, outline.height];
  const scale = Math.min(1, LARGEST / Math.max(...size));
  const canvas = make("canvas", {
    width: Math.round(size[0] * scale),
    height: Math.round(size[1] * scale),
    tabindex: 0,
    role: "application",
    "aria-label": "The rectified picture to paint on",
    "aria-describedby": "paint-help",
  });
  canvas.style.width = `min(100%, ${Math.round((80 * size[0]) / size[1])}vh)`; // a small picture is painted on enlarged
  const told = make("p", { class: "soft", role: "status", id: "paint-told" });
  const failed = alertLine();
  const state = { tool: "rectangle", stroke: null, corner: null, cursor: null, shade: null, mask: null, hand: [0, 0] };

  const brush = make("input", { type: "range", min: 1, max: 100, value: 25, "aria-label": "Brush size" });
  const radius = () => Math.max(1, Math.round((Math.max(...size) / 8) * (brush.value / 100) ** 1.5 * 10) / 10);
  const undo = button("Undo", () => strokes.undo(), { disabled: true, "aria-keyshortcuts": "Control+Z" });
  const clear = button("Clear", () => strokes.clear(), { disabled: true });
  const tools = make(
    "fieldset",
    { class: "tools" },
    make("legend", {}, "Paint with"),
    TOOLS.map(([value, text]) =>
      make(
        "label",
        {},
        make("input", {
          type: "radio",
          name: "tool",
          value,
          checked: value === state.tool,
          change: () => (state.tool = value),
        }),
        ` ${text}`,
      ),
    ),
  );
  const numbers = SIDES.map(() => make("input", { type: "number", min: 0, step: 1, inputmode: "numeric" }));
  const place = button("Set the rectangle", () => {
    const [x, y, wide, high] = numbers.map((input) => Number(input.value));
    const rectangle = rectangleBetween([x - 0.5, y - 0.5], [x + wide - 0.5, y + high - 0.5], size);
    if (rectangle) strokes.setRectangle(rectangle);
    else say(told, `Give a rectangle of 3 px a side or more within ${size[0]} × ${size[1]} px.`);
  });

  const strokes = new Strokes(() => {
    undo.disabled = !strokes.canUndo;
    clear.disabled = strokes.empty;
    strokes.now.rectangle?.forEach((value, index) => (numbers[index].value = value));
    mask.ask(strokes.empty ? null : strokes.now);
    if (strokes.empty) say(told, "Nothing is painted: everything that both cameras see is wanted.");
    draw();
  });
  const mask = new OutlineMask(
    outline.id,
    ({ busy, mask: blob, bitmap, error, gone: lost }) => {
      if (busy) return say(told, "Looking for the outline …");
      Object.assign(state, { mask: blob, shade: null });
      say(failed, error);
      if (lost) return gone();
      if (error) say(told, "");
      if (bitmap) {
        const found = maskPicture(bitmap, canvas.width, canvas.height);
        bitmap.close();
        state.shade = found.shade;
        say(told, `The outline holds ${(100 * found.share).toFixed(found.share < 0.1 ? 1 : 0)} % of the picture.`);
      }
      draw();
    },
    signal,
  );

  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      drawScene(canvas, outline.bitmap, scale, strokes.now, state, radius());
    });
  }

  // Begin, go on with and end a rectangle or a stroke at a place, px of the picture.
  const hand = {
    begin(at) {
      if (state.tool === "rectangle") state.corner = at;
      else extend((state.stroke = { kind: state.tool, radius: radius(), points: [] }), at);
      hand.move(at);
    },
    move(at) {
      state.hand = at;
      if (state.stroke) extend(state.stroke, at);
      draw();
    },
    end(at) {
      hand.move(at);
      const { corner, stroke } = state;
      hand.abandon();
      if (corner) {
        const rectangle = rectangleBetween(corner, at, size);
        if (rectangle) strokes.setRectangle(rectangle);
        else say(told, "The rectangle is too small: draw it around the whole object.");
      }
      if (stroke) strokes.addStroke(stroke.kind, { radius: stroke.radius, points: stroke.points });
    },
    abandon() {
      state.corner = state.stroke = null;
      draw();
    },
    holds: () => Boolean(state.corner || state.stroke),
    undo: () => strokes.undo(),
    show: (cursor) => {
      state.cursor = cursor;
      draw();
    },
    tell: (text) => say(told, text),
  };
  brush.addEventListener("input", draw);
  pointer(canvas, size, hand);
  keyboard(canvas, size, hand);
  say(told, "Draw a rectangle around the object.");
  draw();

  // Enter in a field would start the job amid the painting.
  const keydown = (event) => {
    if (event.key !== "Enter" || event.target.tagName !== "INPUT") return;
    event.preventDefault();
    if (numbers.includes(event.target)) place.click();
  };
  const element = make(
    "div",
    { keydown },
    tools,
    make("p", { class: "buttons" }, make("label", { class: "brush" }, "Brush ", brush), undo, clear),
    make("div", { class: "surface" }, canvas),
    told,
    failed,
    make(
      "p",
      { class: "soft", id: "paint-help" },
      "With keys: arrows move the cross, with Shift faster; Enter begins and ends a rectangle or a stroke, ",
      "Escape drops it, Ctrl Z takes the last one back.",
    ),
    make(
      "details",
      {},
      make("summary", {}, "The rectangle in numbers"),
      make(
        "div",
        { class: "columns four" },
        SIDES.map((name, index) => field(name, numbers[index])),
      ),
      make("p", { class: "buttons" }, place),
    ),
  );

  /** The mask of what is painted, once it is there; null where nothing is painted. Throws where there is none. */
  async function final() {
    await mask.settled();
    if (strokes.empty) return null;
    if (!state.mask)
      throw new Error(failed.textContent || "there is no outline yet: paint anew, or clear what is painted");
    return state.mask;
  }
  return { element, mask: final };
}
