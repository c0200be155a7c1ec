// The two pictures of a pair: chosen, taken with a phone, or dropped, both at once too.

import { button, field, make, say } from "./dom.js";
import { bytesWords } from "./words.js";

// By name, so that a phone turns its own format into JPEG.
export const FORMATS = ".png,.jpg,.jpeg,.webp,.tif,.tiff,.bmp,.pgm,.ppm,.pnm,image/png,image/jpeg,image/webp";
const SIDES = ["left", "right"];

/** An element to choose a pair in; `changed()` is called when it has changed, `files` holds the two or null. */
export function pairChooser(changed) {
  const files = { left: null, right: null };
  const slots = Object.fromEntries(SIDES.map((side) => [side, slot(side, (file) => set({ [side]: file }))]));
  const element = make(
    "div",
    { class: "pair" },
    SIDES.map((side) => slots[side].element),
  );
  const swap = button("Swap left and right", () => set({ left: files.right, right: files.left }));

  function set(given) {
    Object.assign(files, given);
    for (const side of SIDES) slots[side].show(files[side]);
    swap.disabled = !files.left && !files.right;
    changed();
  }
  whenDropped(element, (dropped, target) => {
    if (dropped.length === 1)
      set({ [SIDES.find((side) => slots[side].element.contains(target)) ?? "left"]: dropped[0] });
    else set(inOrder(dropped));
  });
  swap.disabled = true;
  return { element: make("div", {}, element, make("p", { class: "buttons" }, swap)), files, set };
}

/** Which of several dropped files is the left one: by what their names say, else by their order. */
function inOrder(dropped) {
  const named = (side) => dropped.find((file) => file.name.toLowerCase().includes(side));
  const sorted = byName(dropped);
  const left = named("left") ?? sorted.find((file) => file !== named("right"));
  return { left, right: named("right") ?? sorted.find((file) => file !== left) };
}

/** Files in the order of their names, 2 before 10. */
export const byName = (files) => [...files].sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));

/** Call `take(files, target)` for what is dropped on an element. */
export function whenDropped(element, take) {
  const over = (event) => {
    event.preventDefault();
    element.classList.add("over");
  };
  const out = () => element.classList.remove("over");
  element.addEventListener("dragover", over);
  element.addEventListener("dragleave", out);
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    out();
    const files = [...event.dataTransfer.files];
    if (files.length) take(files, event.target);
  });
}

function slot(side, choose) {
  const input = make("input", {
    type: "file",
    accept: FORMATS,
    change: () => input.files[0] && choose(input.files[0]),
  });
  const told = make("p", { class: "soft name" });
  const image = make("img", { alt: "", hidden: true });
  const empty = make("p", { class: "empty", "aria-hidden": "true" }, `Drop the ${side} picture here, or both`);
  let shown = null;
  image.addEventListener("error", () => {
    image.hidden = true;
    say(told, `${told.textContent}: this browser has no preview of it`);
  });
  const show = (file) => {
    if (file === shown) return;
    if (shown) URL.revokeObjectURL(image.src);
    shown = file;
    image.hidden = !file;
    empty.hidden = Boolean(file);
    say(told, file ? `${file.name}, ${bytesWords(file.size)}` : "");
    if (!file) image.removeAttribute("src");
    else image.src = URL.createObjectURL(file);
    image.alt = file ? `the ${side} picture, ${file.name}` : "";
    if (input.files[0] !== file) input.value = ""; // after a drop or a swap it would name another file
  };
  const title = `${side.charAt(0).toUpperCase()}${side.slice(1)} picture`;
  return { element: make("div", { class: "slot" }, field(title, input), image, empty, told), show };
}
