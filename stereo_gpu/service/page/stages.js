// The stages of a job as a list: done with their seconds, running, to come.

import { make } from "./dom.js";
import { secondsWords, stageWords } from "./words.js";

/** A list that `update(job)` keeps up to date. */
export function stageList() {
  const list = make("ol", { class: "stages" });
  const total = make("p", { class: "soft total", hidden: true });
  const rows = new Map();
  const update = (job) => {
    const names = job.stages ?? [];
    if (names.some((name) => !rows.has(name))) {
      rows.clear();
      for (const name of names) {
        const seconds = make("span", { class: "seconds" });
        rows.set(name, { seconds, item: make("li", {}, make("span", {}, stageWords(name)), seconds) });
      }
      list.replaceChildren(...[...rows.values()].map(({ item }) => item));
    }
    const at = names.indexOf(job.stage);
    names.forEach((name, index) => {
      const { item, seconds } = rows.get(name);
      const taken = job.seconds?.[name];
      const running = job.state === "running" && index === at;
      item.dataset.at = "later";
      const failed = job.state === "failed" && at >= 0;
      if (taken !== undefined || job.state === "done" || (failed && index < at)) item.dataset.at = "done";
      if (running) item.dataset.at = "now";
      if (failed && index === at) item.dataset.at = "bad";
      if (running) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
      seconds.textContent = taken === undefined ? "" : secondsWords(taken);
    });
    const sum = job.seconds?.total;
    total.hidden = sum === undefined;
    total.textContent = sum === undefined ? "" : `${secondsWords(sum)} in all`;
  };
  return { element: make("div", {}, list, total), update };
}
