// The gallery: a page of jobs, kept up to date.

import { getJson } from "./api.js";
import { pause } from "./connection.js";
import { alertLine, choice, field, make, say } from "./dom.js";
import { ENDED } from "./events.js";
import { picture } from "./pictures.js";
import { jobName, momentWords, stageWords, stateWords } from "./words.js";

const EVERY = 3000; // ms between looks at jobs that still go on; with none, four times that
const LIMIT = 24;
const LARGEST_INPUT = 3e6; // bytes: a picture as it was sent stands in for a step's up to this size

/** Show a page of jobs; state, kind, limit and after stand in the address. */
export function show(main, { query, signal }) {
  const state = choice(
    [["", "all"], ...["queued", "running", "done", "failed", "cancelled"].map((name) => [name, stateWords(name)])],
    query.get("state") ?? "",
    go,
  );
  const kind = choice(
    [
      ["", "all"],
      ["reconstruction", "models"],
      ["calibration", "calibrations"],
    ],
    query.get("kind") ?? "",
    go,
  );
  const told = make("p", { class: "soft", role: "status" }, "Loading …");
  const failed = alertLine();
  const grid = make("ul", { class: "grid" });
  const pages = make("nav", { class: "buttons", "aria-label": "Pages" });
  const cards = new Map();
  main.append(
    make("h1", {}, "Jobs"),
    make("div", { class: "columns filters" }, field("State", state), field("Kind", kind)),
    told,
    failed,
    grid,
    pages,
  );

  function go() {
    location.hash = address({ ...chosen(), state: state.value, kind: kind.value });
  }

  function update({ items, next }) {
    say(failed, "");
    say(told, items.length ? "" : String(query) ? "No jobs here." : "No jobs yet: begin with New model.");
    for (const [id, card] of cards) {
      if (items.some((job) => job.id === id)) continue;
      card.leave();
      cards.delete(id);
    }
    items.forEach((job, index) => {
      const card = cards.get(job.id) ?? newCard(job, signal);
      cards.set(job.id, card);
      card.update(job);
      if (grid.children[index] !== card.element) grid.insertBefore(card.element, grid.children[index] ?? null);
    });
    const after = next && new URLSearchParams(next.split("?")[1]).get("after");
    const links = [
      query.get("after") && make("a", { class: "button", href: address({ ...chosen() }) }, "Newest"),
      after && make("a", { class: "button", href: address({ ...chosen(), after }) }, "Older"),
    ].filter(Boolean);
    if (links.map(String).join() !== [...pages.children].map(String).join()) pages.replaceChildren(...links);
  }
  const chosen = () => ({ state: query.get("state"), kind: query.get("kind"), limit: query.get("limit") });

  (async () => {
    const wanted = new URLSearchParams({ limit: LIMIT });
    for (const name of ["state", "kind", "limit", "after"]) if (query.get(name)) wanted.set(name, query.get(name));
    while (!signal.aborted) {
      let lively = false;
      try {
        const page = await getJson(`/v1/jobs?${wanted}`, signal);
        lively = page.items.some((job) => !ENDED.includes(job.state));
        update(page);
      } catch (error) {
        if (signal.aborted) return;
        say(told, "");
        say(failed, error.message);
      }
      do await pause(lively ? EVERY : 4 * EVERY, signal).catch(() => {});
      while (document.hidden && !signal.aborted);
    }
  })();
  return "Jobs";
}

function address(values) {
  const query = new URLSearchParams(Object.entries(values).filter(([, value]) => value));
  return String(query) ? `#/jobs?${query}` : "#/jobs";
}

function newCard(first, signal) {
  const leaving = new AbortController();
  signal.addEventListener("abort", () => leaving.abort(signal.reason), { once: true });
  const name = make("a", { href: `#/jobs/${first.id}` });
  const state = make("span", { class: "state" });
  const more = make("p", { class: "soft" });
  const frame = make("div", { class: "thumb", "aria-hidden": "true" });
  const bar = make("progress", { max: 1, "aria-label": "progress", hidden: true });
  let shown = "";
  const update = (job) => {
    say(name, jobName(job));
    say(state, stateWords(job.state));
    state.dataset.state = job.state;
    bar.hidden = job.state !== "running";
    bar.value = job.fraction ?? 0;
    say(more, lines(job));
    const path = thumb(job);
    if (path && path !== shown) frame.replaceChildren(picture(path, "", leaving.signal, { lazy: true }));
    shown = path;
  };
  const element = make("li", { class: "card job" }, frame, make("div", { class: "what" }, name, state, bar, more));
  return { element, update, leave: () => (element.remove(), leaving.abort(new DOMException("gone", "AbortError"))) };
}

function lines(job) {
  if (job.state === "failed") return job.error ?? "";
  if (job.state === "running" && job.stage) return stageWords(job.stage);
  if (job.state === "queued" && job.place !== null) return job.place ? `${job.place} before it` : "next";
  return momentWords(job.ended ?? job.created);
}

function thumb(job) {
  const step = job.steps?.at(-1)?.href;
  if (step) return step;
  const input = job.inputs?.find(({ bytes, name }) => bytes <= LARGEST_INPUT && /\.(png|jpe?g|webp|bmp)$/.test(name));
  return input?.href ?? "";
}
