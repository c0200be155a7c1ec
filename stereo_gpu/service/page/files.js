// The files of a result, each with a button that brings it.

import { getBlob } from "./api.js";
import { alertLine, button, make, say } from "./dom.js";
import { bytesWords, fileOrder, fileWords, jobName } from "./words.js";

const LIFE = 60_000; // ms that a browser gets to write a file that it was handed

/** A table of files to download. */
export function downloads(items, job, signal) {
  const told = alertLine();
  const rows = inOrder(items).map((item) => {
    const get = button("Download", () => fetchFile(item, job, get, told, signal), {
      "aria-label": `Download ${item.name}`,
    });
    return make(
      "tr",
      {},
      make("th", { scope: "row" }, item.name, make("small", {}, fileWords(item.name))),
      make("td", { class: "number" }, bytesWords(item.bytes)),
      make("td", {}, get),
    );
  });
  return make(
    "section",
    {},
    make("h2", {}, "Files"),
    make("div", { class: "card" }, make("table", { class: "files" }, make("tbody", {}, rows)), told),
  );
}

/** The model first, what nobody asks for last. */
const inOrder = (items) =>
  [...items].sort((a, b) => fileOrder(a.name) - fileOrder(b.name) || a.name.localeCompare(b.name));

async function fetchFile(item, job, get, told, signal) {
  say(told, "");
  get.disabled = true;
  get.textContent = "Coming …";
  try {
    const address = URL.createObjectURL(await getBlob(item.href, signal));
    const name = jobName(job)
      .replace(/[^\p{L}\p{N}._-]+/gu, "_")
      .slice(0, 60);
    make("a", { href: address, download: `${name}_${item.name}` }).click();
    setTimeout(() => URL.revokeObjectURL(address), LIFE);
  } catch (error) {
    if (!signal.aborted) say(told, `${item.name}: ${error.message}`);
  } finally {
    get.disabled = false;
    get.textContent = "Download";
  }
}
