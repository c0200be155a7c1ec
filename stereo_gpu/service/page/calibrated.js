// What a calibration found: errors, coverage, arrows, views, advice, and the rig to use.

import { getJson } from "./api.js";
import { make } from "./dom.js";
import { picture } from "./pictures.js";

/** The result of a calibration job, from its files. */
export async function calibrationResult(job, items, signal) {
  const found = (name) => items.find((item) => item.name === name);
  const record = found("calibration.json") ? await getJson(found("calibration.json").href, signal) : {};
  const drawings = items.filter(({ name }) => name.endsWith(".svg"));
  return make("div", {},
    make("section", { class: "card" }, tiles(record),
      job.rig && make("p", { class: "buttons" }, make("a", { class: "button main", href: `#/new?rig=${job.rig}` }, "Use this rig"))),
    advice(record.advice ?? []),
    drawings.length ? make("section", {}, make("h2", {}, "Coverage and errors"), make("div", { class: "figures" },
      drawings.map(({ name, href }) => make("figure", {}, picture(href, words(name), signal), make("figcaption", {}, words(name)))))) : null,
    views(record.views ?? []));
}

const words = (name) => {
  const plain = name.replace(/\.svg$/, "").replaceAll("_", " ");
  return plain.charAt(0).toUpperCase() + plain.slice(1);
};
const pixels = (value) => (typeof value === "number" ? `${value.toFixed(3)} px` : "none");

function tiles(record) {
  const facts = [
    ["Reprojection error", pixels(record.rms_px)],
    ["Epipolar error", pixels(record.epipolar_rms_px)],
    ["Baseline", record.baseline ? `${record.baseline.toFixed(2)} ${record.unit ?? ""}` : "none"],
  ];
  return make("dl", { class: "tiles" }, facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
}

function advice(lines) {
  if (!lines.length) return null;
  return make("section", { class: "warnings" }, make("h2", {}, "Advice"), make("ul", {}, lines.map((line) => make("li", {}, line))));
}

function views(list) {
  if (!list.length) return null;
  const head = ["Left", "Right", "Left error", "Right error", ""].map((text) => make("th", { scope: "col" }, text));
  return make("section", {}, make("h2", {}, "Views"), make("div", { class: "card scroll", tabindex: 0, role: "region", "aria-label": "Errors of each view" },
    make("table", { class: "views" }, make("thead", {}, make("tr", {}, head)), make("tbody", {}, list.map((view) => make("tr", { class: view.used ? "" : "out" },
      make("td", {}, view.left), make("td", {}, view.right), make("td", { class: "number" }, pixels(view.left_rms_px)),
      make("td", { class: "number" }, pixels(view.right_rms_px)), make("td", {}, view.used ? "" : `left out: ${view.reason}`)))))));
}
