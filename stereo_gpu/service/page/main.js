// The page's start: the token, and a view for each address.

import * as calibrate from "./calibrate.js";
import { make } from "./dom.js";
import * as job from "./job.js";
import * as jobs from "./jobs.js";
import * as create from "./new.js";
import { takeToken } from "./session.js";

const VIEWS = [
  [/^#\/jobs\/([0-9a-f]{32})$/, job, "#/jobs"],
  [/^#\/jobs$/, jobs, "#/jobs"],
  [/^#\/calibrate$/, calibrate, "#/calibrate"],
  [/^#\/new$/, create, "#/new"],
];

const main = document.getElementById("main");
let leaving = new AbortController();
let first = true;

/** Show what the address names; each view gets a signal that tells it when it is left. */
function route() {
  leaving.abort(new DOMException("the view was left", "AbortError"));
  leaving = new AbortController();
  const [address, query] = location.hash.split("?");
  const found = VIEWS.map(([pattern, view, tab]) => [pattern.exec(address), view, tab]).find(([match]) => match);
  const [match, view, tab] = found ?? [null, create, "#/new"];
  for (const link of document.querySelectorAll("nav a")) {
    if (link.getAttribute("href") === tab) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  main.replaceChildren();
  const title = view.show(main, { id: match?.[1], query: new URLSearchParams(query ?? ""), signal: leaving.signal });
  document.title = `${title} · Stereo reconstruction`;
  if (!first) {
    const heading = main.querySelector("h1") ?? main;
    heading.tabIndex = -1;
    heading.focus({ preventScroll: true });
    window.scrollTo(0, 0);
  }
  first = false;
}

document.getElementById("skip").addEventListener("click", (event) => {
  event.preventDefault(); // the fragment is the view's address
  main.focus();
});
window.addEventListener("hashchange", () => {
  takeToken();
  route();
});
window.addEventListener("unhandledrejection", (event) => {
  if (event.reason?.name === "AbortError")
    event.preventDefault(); // a view that was left while it waited
  else main.prepend(make("p", { class: "alert", role: "alert" }, String(event.reason?.message ?? event.reason)));
});
// A file that is dropped beside its place would be opened instead of the page.
for (const name of ["dragover", "drop"]) window.addEventListener(name, (event) => event.preventDefault());
takeToken();
route();
