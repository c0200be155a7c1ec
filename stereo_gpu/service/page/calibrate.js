// A calibration: board pictures of both cameras, what the board is, and then the job.

import { jobSender } from "./api.js";
import { alertLine, choice, field, make, say } from "./dom.js";
import { byName, FORMATS, whenDropped } from "./pair.js";
import { bytesWords } from "./words.js";

const DICTIONARIES = ["4x4", "5x5", "6x6", "7x7"]
  .flatMap((cells) => [50, 100, 250, 1000].map((count) => `${cells}_${count}`))
  .concat("aruco_original", "apriltag_16h5", "apriltag_25h9", "apriltag_36h10", "apriltag_36h11");
let form = null; // is kept while other views are shown

/** Show the form. */
export function show(main) {
  form ??= build();
  main.append(form);
  return "Calibrate";
}

function build() {
  const told = alertLine();
  const busy = make("p", { class: "soft", role: "status", hidden: true });
  const columns = make("input", { type: "number", min: 3, max: 99, step: 1, value: 10, inputmode: "numeric" });
  const rows = make("input", { type: "number", min: 3, max: 99, step: 1, value: 7, inputmode: "numeric" });
  const square = make("input", { type: "number", min: 0, step: "any", value: 30, inputmode: "decimal" });
  const marker = make("input", {
    type: "number",
    min: 0,
    step: "any",
    placeholder: "a plain checkerboard",
    inputmode: "decimal",
  });
  const dictionary = choice(
    [["", "5x5_250, the usual one"], ...DICTIONARIES.filter((name) => name !== "5x5_250").map((name) => [name, name])],
    "",
  );
  const label = make("input", { type: "text", maxlength: 200, autocomplete: "off" });
  const start = make("button", { class: "main" }, "Calibrate");
  const pairs = make("ol", { class: "pairs" });
  const count = make("p", { class: "soft", role: "status" });
  const files = { left: [], right: [] };
  const sendJob = jobSender("/v1/calibrations");

  function slot(side) {
    const input = make("input", {
      type: "file",
      multiple: true,
      accept: FORMATS,
      change: () => input.files.length && take(input.files, side),
    });
    const element = make(
      "div",
      { class: "slot" },
      field(`Pictures of the ${side} camera`, input),
      make("p", { class: "empty", "aria-hidden": "true" }, "Drop them here"),
    );
    whenDropped(element, (dropped) => {
      input.value = "";
      take(dropped, side);
    });
    return element;
  }

  /** Files for one side; where their names say that some are of the other camera these go there. */
  function take(given, side) {
    const other = side === "left" ? "right" : "left";
    const strays = [...given].filter(
      ({ name }) => name.toLowerCase().includes(other) && !name.toLowerCase().includes(side),
    );
    const mixed = strays.length > 0 && strays.length < given.length;
    files[side] = byName([...given].filter((file) => !mixed || !strays.includes(file)));
    if (mixed) files[other] = byName(strays);
    list();
  }

  function list() {
    say(told, "");
    const [left, right] = [files.left.length, files.right.length];
    const bytes = [...files.left, ...files.right].reduce((sum, { size }) => sum + size, 0);
    say(
      count,
      left + right === 0
        ? ""
        : left === right
          ? `${left} pairs, ${bytesWords(bytes)}`
          : `${left} pictures of the left camera and ${right} of the right one: each needs its partner.`,
    );
    count.classList.toggle("bad", left !== right);
    pairs.replaceChildren(
      ...Array.from({ length: Math.max(left, right) }, (_, index) =>
        make("li", {}, `${files.left[index]?.name ?? "none"} and ${files.right[index]?.name ?? "none"}`),
      ),
    );
  }

  async function submit(event) {
    event.preventDefault();
    say(told, "");
    if (!files.left.length || !files.right.length) return say(told, "Choose the board pictures of both cameras first.");
    if (files.left.length !== files.right.length) return say(told, count.textContent);
    const data = new FormData();
    for (const side of ["left", "right"]) for (const file of files[side]) data.append(side, file, file.name);
    data.append("board", `${columns.value}x${rows.value}`);
    data.append("square", square.value);
    if (marker.value) data.append("marker", marker.value);
    if (marker.value && dictionary.value) data.append("dictionary", dictionary.value);
    if (label.value.trim()) data.append("label", label.value.trim());
    start.disabled = true;
    say(busy, "Sending the pictures …");
    try {
      const board = [columns, rows, square, marker, dictionary, label].map((input) => input.value);
      const job = await sendJob(data, [...files.left, ...files.right, ...board]);
      if (element.isConnected) location.hash = `#/jobs/${job.id}`; // else another view is looked at by now
    } catch (error) {
      say(told, error.message);
    } finally {
      start.disabled = false;
      say(busy, "");
    }
  }

  list();
  const element = make(
    "form",
    { submit, novalidate: true },
    make("h1", {}, "Calibrate"),
    make(
      "p",
      { class: "soft" },
      "Pictures of a board, taken by both cameras at the same moments, tell how the cameras stand: 10 pairs or more, ",
      "the board near and far, tilted to all sides, in every part of the picture. ",
      make("code", {}, "stereo-gpu board"),
      " draws one to print.",
    ),
    make(
      "section",
      { class: "card" },
      make("h2", {}, "Board pictures"),
      make("div", { class: "pair" }, slot("left"), slot("right")),
      count,
      make("details", {}, make("summary", {}, "The pairs, in the order of their names"), pairs),
    ),
    make(
      "section",
      { class: "card" },
      make("h2", {}, "Board"),
      make(
        "div",
        { class: "columns" },
        field("Squares across", columns, "As printed: one more than the inner corners."),
        field("Squares down", rows),
        field("Side of a square, mm", square, "Measured on the print: it sets the scale of every model."),
      ),
      make(
        "details",
        {},
        make("summary", {}, "A ChArUco board, with markers in its white squares"),
        make("div", { class: "columns" }, field("Side of a marker, mm", marker), field("Dictionary", dictionary)),
      ),
    ),
    make("section", { class: "card" }, field("Name of the rig", label, "Only for you; may stay empty.")),
    told,
    busy,
    make("p", { class: "buttons" }, start),
  );
  return element;
}
