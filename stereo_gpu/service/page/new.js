// A new model: two pictures, a rig, what is wanted of them, options; then the job.

import { getBlob, getJson, jobSender } from "./api.js";
import { alertLine, button, field, make, say } from "./dom.js";
import { openOutline } from "./outline.js";
import { optionFields } from "./options.js";
import { painter } from "./paint.js";
import { pairChooser } from "./pair.js";
import { rigPicker } from "./rigs.js";

let form = null; // is kept while other views are shown: a calibration in between loses nothing

/** Show the form. */
export function show(main, { query, signal }) {
  form ??= build();
  main.append(form.element);
  form.load(signal, query.get("rig") ?? undefined, query.get("from"));
  return "New model";
}

function build() {
  const told = alertLine();
  const busy = make("p", { class: "soft", role: "status", hidden: true });
  const label = make("input", { type: "text", maxlength: 200, placeholder: "cup", autocomplete: "off" });
  const start = make("button", { class: "main" }, "Start");
  const area = make("div", {});
  const paint = button("Paint the object", openPainter, { disabled: true });
  const paintTold = make("p", { class: "soft", role: "status", hidden: true });
  const paintFailed = alertLine();
  const pair = pairChooser(changed);
  const rigs = rigPicker(changed);
  const options = optionFields(changed);
  let painting = null; // {stop, painter}
  const sendJob = jobSender("/v1/jobs");

  /** What the outline belongs to has changed: it goes. */
  function changed() {
    say(told, "");
    say(paintFailed, "");
    closePainter("What was painted is gone: it belonged to other pictures, another rig or the other view.");
    paint.disabled = !(pair.files.left && pair.files.right && rigs.state.id);
    paint.title = paint.disabled ? "Choose both pictures and a rig first" : "";
  }

  function closePainter(why) {
    if (!painting) return;
    painting.stop.abort(new DOMException("the painter was closed", "AbortError"));
    painting = null;
    area.replaceChildren();
    paint.textContent = "Paint the object";
    say(paintTold, why);
  }

  async function openPainter() {
    if (painting) return closePainter("");
    const stop = new AbortController();
    painting = { stop, painter: null };
    paint.textContent = "Take everything instead";
    say(paintFailed, "");
    say(paintTold, "Rectifying the pair …");
    try {
      const outline = await openOutline(
        { ...pair.files, rig: rigs.state.id, reference: options.reference() },
        stop.signal,
      );
      const gone = () => closePainter("The service has let go of this picture: open it again to paint on.");
      painting.painter = painter(outline, gone, stop.signal);
      area.replaceChildren(painting.painter.element);
      say(paintTold, "");
      area.querySelector("input[name=tool]").focus({ preventScroll: true });
    } catch (error) {
      if (stop.signal.aborted) return;
      closePainter("");
      say(paintFailed, error.message);
    }
  }

  async function submit(event) {
    event.preventDefault();
    say(told, "");
    const lacks = [
      [pair.files.left, "the left picture"],
      [pair.files.right, "the right picture"],
      [rigs.state.id, "a rig"],
    ]
      .filter(([given]) => !given)
      .map(([, name]) => name);
    if (lacks.length) return say(told, `Choose ${lacks.join(" and ")} first.`);
    start.disabled = true;
    say(busy, "Sending the pair …");
    try {
      const mask = painting?.painter ? await painting.painter.mask() : null;
      const job = await post(mask);
      if (element.isConnected) location.hash = `#/jobs/${job.id}`; // else another view is looked at by now
    } catch (error) {
      const later = error.retrySeconds ? ` Try again in ${error.retrySeconds} s.` : "";
      say(told, error.message + later);
    } finally {
      start.disabled = false;
      say(busy, "");
    }
  }

  function post(mask) {
    const { left, right } = pair.files;
    const given = JSON.stringify(options.value());
    const name = label.value.trim();
    const data = new FormData();
    data.append("left", left, left.name);
    data.append("right", right, right.name);
    data.append("rig", rigs.state.id);
    if (mask) data.append("mask", mask, "mask.png");
    data.append("options", given);
    if (name) data.append("label", name);
    return sendJob(data, [left, right, rigs.state.id, mask, given, name]);
  }

  const element = make(
    "form",
    { submit, novalidate: true },
    make("h1", {}, "New model"),
    make(
      "section",
      { class: "card" },
      make("h2", {}, "Pictures"),
      make(
        "p",
        { class: "soft" },
        "One of each camera, taken at the same moment, as they came: not cropped, scaled or turned.",
      ),
      pair.element,
    ),
    make("section", { class: "card" }, make("h2", {}, "Rig"), rigs.element),
    make(
      "section",
      { class: "card" },
      make("h2", {}, "Object"),
      make(
        "p",
        { class: "soft" },
        "Paint it, and only it becomes a model; otherwise everything that both cameras see does.",
      ),
      make("p", { class: "buttons" }, paint),
      paintTold,
      paintFailed,
      area,
    ),
    make(
      "section",
      { class: "card" },
      make("h2", {}, "Options"),
      options.element,
      field("Name of the job", label, "Only for you; may stay empty."),
    ),
    told,
    busy,
    make("p", { class: "buttons" }, start),
  );

  /** Bring the rigs up to date; choose one, or the pair and the rig of an earlier job. */
  async function load(signal, rig, from) {
    say(told, "");
    try {
      if (from) rig = await fetchPair(from, signal);
      await rigs.load(signal, rig);
    } catch (error) {
      if (!signal.aborted) say(told, error.message);
    }
  }

  async function fetchPair(id, signal) {
    const job = await getJson(`/v1/jobs/${encodeURIComponent(id)}`, signal);
    const fetched = ["left", "right"].map(async (side) => {
      const input = job.inputs.find(({ name }) => name.startsWith(`${side}.`));
      const blob = await getBlob(input.href, signal);
      return new File([blob], input.given || input.name, { type: blob.type, lastModified: Date.parse(job.created) });
    });
    const [left, right] = await Promise.all(fetched);
    pair.set({ left, right });
    label.value = job.label;
    return job.rig;
  }
  return { element, load };
}
