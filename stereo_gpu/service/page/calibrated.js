// What a calibration found: errors, coverage, arrows, the next best view, every view, and the rig to use.

import { getJson } from "./api.js";
import { make } from "./dom.js";
import { picture } from "./pictures.js";

export const NEXT = "next:"; // how the advice opens that tells which view to take

const DRAWINGS = [
  ["coverage-left.svg", "Coverage of the left picture: how many views have a corner in each part"],
  ["coverage-right.svg", "Coverage of the right picture"],
  ["arrows-left.svg", "What is left over in the left picture: arrows, drawn larger than they are"],
  ["arrows-right.svg", "What is left over in the right picture"],
];

/** The result of a calibration job, from its files. */
export async function calibrationResult(job, items, signal) {
  const found = (name) => items.find((item) => item.name === name);
  const record = await getJson(found("calibration.json").href, signal);
  const given = Object.fromEntries(job.inputs.map((input) => [input.name, input.given || input.name]));
  const drawings = DRAWINGS.filter(([name]) => found(name));
  return make(
    "div",
    {},
    make(
      "section",
      { class: "card" },
      tiles(record),
      job.rig &&
        make(
          "p",
          { class: "buttons" },
          make("a", { class: "button main", href: `#/new?rig=${job.rig}` }, "Use this rig"),
        ),
    ),
    nextView(record.advice),
    make(
      "section",
      {},
      make("h2", {}, "Coverage and errors"),
      make(
        "div",
        { class: "figures drawn" },
        drawings.map(([name, words]) =>
          make("figure", {}, picture(found(name).href, words, signal), make("figcaption", {}, words)),
        ),
      ),
    ),
    views(record.views, given),
  );
}

const pixels = (value) => (typeof value === "number" ? `${value.toFixed(3)} px` : "none");
const percent = (share) => `${Math.round(100 * share)} %`;

function tiles({ rig, pairs, used, coverage, depth }) {
  const facts = [
    ["Pairs used", `${used} of ${pairs}`],
    ["Reprojection error", pixels(rig.rms_px)],
    ["Epipolar error", pixels(rig.epipolar_rms_px)],
    ["Baseline", `${rig.baseline.toFixed(2)} ${rig.unit}`],
    ["Coverage, left and right", `${percent(coverage.left)}, ${percent(coverage.right)}`],
    depth && [
      `Depth at ${depth.at.toFixed(0)} ${rig.unit} certain to`,
      `${depth.deviation.toPrecision(2)} ${rig.unit}`,
    ],
  ].filter(Boolean);
  return make(
    "dl",
    { class: "tiles" },
    facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))),
  );
}

function nextView(advice) {
  const lines = advice.filter((line) => line.startsWith(NEXT)).map((line) => line.slice(NEXT.length).trim());
  if (!lines.length) return null;
  return make(
    "section",
    { class: "card" },
    make("h2", {}, "Next best view"),
    lines.map((line) => make("p", {}, `${line.charAt(0).toUpperCase()}${line.slice(1)}.`)),
  );
}

function views(list, given) {
  const head = ["Left", "Right", "Left error", "Right error", "Epipolar error"].map((text) =>
    make("th", { scope: "col", class: text.endsWith("error") ? "number" : null }, text),
  );
  const numbers = ({ left_px: left, right_px: right, epipolar_px: rows }) =>
    [left, right, rows].map((value) => make("td", { class: "number" }, pixels(value)));
  const row = (view) =>
    make(
      "tr",
      { class: view.used ? null : "out" },
      make("td", {}, given[view.left] ?? view.left, !view.used && make("small", {}, `left out: ${view.reason}`)),
      make("td", {}, given[view.right] ?? view.right),
      numbers(view),
    );
  return make(
    "section",
    {},
    make("h2", {}, "Views"),
    make(
      "div",
      { class: "card scroll", tabindex: 0, role: "region", "aria-label": "Errors of each view" },
      make("table", { class: "views" }, make("thead", {}, make("tr", {}, head)), make("tbody", {}, list.map(row))),
    ),
  );
}
