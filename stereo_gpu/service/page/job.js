// One job: its stages and pictures as they come, what went wrong, what it made, and what can be done with it.

import { getJson, persist, Refused, send } from "./api.js";
import { calibrationResult, NEXT } from "./calibrated.js";
import { alertLine, button, make, say } from "./dom.js";
import { follow } from "./events.js";
import { downloads } from "./files.js";
import { modelViewer } from "./model.js";
import { picture } from "./pictures.js";
import { stageList } from "./stages.js";
import { jobName, momentWords, secondsWords, stageWords, stateWords, stepWords } from "./words.js";

/** Show a job and follow it. */
export function show(main, { id, signal }) {
  const path = `/v1/jobs/${id}`;
  const title = make("h1", {}, "Job");
  const state = make("span", { class: "state" });
  const told = make("p", { role: "status", class: "now" }, "Loading …");
  const bar = make("progress", { max: 1, "aria-label": "progress", hidden: true });
  const failed = alertLine(),
    refused = alertLine();
  const warnings = make("section", { class: "warnings", hidden: true });
  const result = make("div", {});
  const steps = make("div", { class: "figures" });
  const stepsPart = make("section", { hidden: true }, make("h2", {}, "Steps"), steps);
  const stages = stageList();
  const inputs = make("div", { class: "figures small" });
  const cancel = button("Cancel", () => act("cancel", "POST", "/cancel"));
  const restart = button("Start again", () => act("start again", "POST", "/restart"));
  const remove = button(
    "Delete",
    () => confirm("Delete this job with its pictures and its result?") && act("delete", "DELETE", ""),
  );
  const other = make("a", { class: "button", href: `#/new?from=${id}`, hidden: true }, "Same pair, other options");
  main.append(
    make("div", { class: "head" }, title, state, make("p", { class: "buttons" }, cancel, restart, other, remove)),
    refused,
    make("section", { class: "card" }, told, bar, failed),
    warnings,
    result,
    stepsPart,
    make(
      "div",
      { class: "two" },
      make("section", {}, make("h2", {}, "Stages"), make("div", { class: "card" }, stages.element)),
      make("section", {}, make("h2", {}, "Pictures as they were sent"), inputs),
    ),
  );
  const shown = { steps: new Map(), inputs: false, result: false, tries: null };
  let attempt = scope(signal);

  function update(job) {
    say(title, jobName(job));
    document.title = `${stateWords(job.state)}: ${jobName(job)} · Stereo reconstruction`;
    say(state, stateWords(job.state));
    state.dataset.state = job.state;
    cancel.hidden = !["queued", "running"].includes(job.state);
    restart.hidden = !["failed", "cancelled"].includes(job.state);
    remove.hidden = !cancel.hidden;
    other.hidden = remove.hidden || job.kind !== "reconstruction";
    bar.hidden = job.state !== "running";
    bar.value = job.fraction ?? 0;
    say(told, words(job));
    say(failed, job.state === "failed" ? (job.error ?? "It failed, and nothing says why.") : "");
    listWarnings(
      warnings,
      (job.warnings ?? []).filter((line) => !line.startsWith(NEXT)),
    );
    stages.update(job);
    if (shown.tries !== job.tries || (shown.result && job.state !== "done")) newTry(job.tries);
    for (const { name, href } of job.steps ?? []) if (!shown.steps.has(name)) addStep(name, href);
    stepsPart.hidden = !shown.steps.size;
    if (!shown.inputs) showInputs(job);
    if (job.state === "done" && !shown.result) showResult(job);
  }

  /** What an earlier try drew goes. */
  function newTry(tries) {
    attempt.leave();
    attempt = scope(signal);
    shown.steps.clear();
    steps.replaceChildren();
    result.replaceChildren();
    Object.assign(shown, { result: false, tries });
  }

  function addStep(name, href) {
    const figure = make(
      "figure",
      { class: name === "rectified" ? "wide" : null },
      picture(href, stepWords(name), attempt.signal),
      make("figcaption", {}, stepWords(name)),
    );
    shown.steps.set(name, figure);
    steps.append(figure);
  }

  function showInputs(job) {
    shown.inputs = true;
    for (const input of job.inputs ?? []) {
      const size = `${input.width} × ${input.height} px`;
      inputs.append(
        make(
          "figure",
          {},
          picture(input.href, input.given || input.name, signal, { lazy: true }),
          make("figcaption", {}, `${input.given || input.name}, ${size}`),
        ),
      );
    }
  }

  async function showResult(job) {
    shown.result = true;
    const own = attempt;
    try {
      const { items } = await getJson(job.links.files, own.signal);
      const model = items.find(({ name }) => name === "model.glb");
      if (job.kind === "calibration") result.append(await calibrationResult(job, items, own.signal));
      else if (model) result.append(modelViewer(model.href, job, own.signal));
      result.append(downloads(items, job, own.signal));
    } catch (error) {
      if (!own.signal.aborted) say(failed, error.message);
    }
  }

  async function act(what, method, end) {
    say(refused, "");
    for (const each of [cancel, restart, remove]) each.disabled = true;
    try {
      await persist(() => send(path + end, { method, signal }), signal);
      if (what === "cancel") say(told, "Cancelling …");
      if (what === "delete") location.hash = "#/jobs";
    } catch (error) {
      if (!signal.aborted) say(refused, error.message);
    } finally {
      for (const each of [cancel, restart, remove]) each.disabled = false;
    }
    if (what === "start again" && !signal.aborted) watch();
  }

  async function watch() {
    try {
      await follow(path, update, signal);
    } catch (error) {
      if (signal.aborted) return;
      say(told, "");
      say(
        refused,
        error instanceof Refused && error.status === 404
          ? "There is no such job: it was deleted, or is another client's."
          : error.message,
      );
      for (const each of [cancel, restart, remove]) each.hidden = true;
    }
  }
  for (const each of [cancel, restart, remove]) each.hidden = true;
  watch();
  return "Job";
}

/** A signal of its own that ends with `signal`, or before. */
function scope(signal) {
  const own = new AbortController();
  const leave = () => own.abort(new DOMException("another try began", "AbortError"));
  signal.addEventListener("abort", leave, { once: true });
  return { signal: own.signal, leave };
}

function words(job) {
  if (job.state === "queued") return job.place ? `Waiting: ${job.place} before it.` : "Waiting: it is next.";
  if (job.state === "running") {
    const again = job.tries > 1 ? ` (try ${job.tries}: the worker of the one before was lost)` : "";
    return `${job.stage ? stageWords(job.stage) : "Starting"} …${again}`;
  }
  const when = momentWords(job.ended ?? job.created);
  const at = job.stage ? ` at “${stageWords(job.stage)}”` : "";
  const taken = job.seconds?.total === undefined ? "" : ` in ${secondsWords(job.seconds.total)}`;
  return (
    { done: `Done${taken}, ${when}.`, failed: `Failed${at}, ${when}.`, cancelled: `Cancelled ${when}.` }[job.state] ??
    job.state
  );
}

function listWarnings(box, lines) {
  const text = lines.join("\n");
  if (box.dataset.text === text) return;
  box.dataset.text = text;
  box.hidden = !lines.length;
  const heading = lines.length === 1 ? "Warning" : `${lines.length} warnings`;
  box.replaceChildren(
    make("h2", {}, heading),
    make(
      "ul",
      {},
      lines.map((line) => make("li", {}, line)),
    ),
  );
}
