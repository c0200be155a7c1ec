// Server-sent events over fetch, since EventSource sends no token; comes back by itself until the job has ended.

import { getJson, Lost, passing, send } from "./api.js";
import { pause, reached, waiting } from "./connection.js";

const SILENT = 30_000; // ms: the service sends a comment every 10 s, so the line is dead after that
const UNSEEN = 5000; // ms between looks at a job while the page is not seen
export const ENDED = ["done", "failed", "cancelled"];

/**
 * Call `changed` with the job at a path now and whenever it changes; returns when it has ended. Throws Refused.
 *
 * A page that nobody sees asks now and then instead: a browser keeps six connections to a service, and a few tabs would
 * hold them all.
 */
export async function follow(path, changed, signal) {
  for (let tries = 0; ; tries++) {
    let ended = false;
    const take = (job) => {
      tries = 0;
      ended = ENDED.includes(job.state);
      changed(job);
    };
    try {
      if (document.hidden) take(await getJson(path, signal));
      else await listen(`${path}/events`, signal, take);
    } catch (error) {
      if (signal.aborted) throw signal.reason;
      if (!passing(error)) throw error;
      if (error instanceof Lost) await reached();
    }
    if (ended) return;
    if (document.hidden) await seen(UNSEEN, signal);
    else await pause(waiting(tries), signal);
  }
}

/** A pause that ends early when the page is seen again. */
async function seen(milliseconds, signal) {
  const either = new AbortController();
  const stop = () => either.abort();
  document.addEventListener("visibilitychange", stop, { once: true });
  signal.addEventListener("abort", stop, { once: true });
  await pause(milliseconds, either.signal).catch(() => {});
  document.removeEventListener("visibilitychange", stop);
  if (signal.aborted) throw signal.reason;
}

async function listen(path, signal, changed) {
  const silence = new AbortController();
  const stop = () => silence.abort(new Lost("the service broke off its events"));
  let timer = setTimeout(stop, SILENT);
  signal.addEventListener("abort", stop);
  document.addEventListener("visibilitychange", stop); // it can only have been hidden
  try {
    const answer = await send(path, { signal: silence.signal, headers: { Accept: "text/event-stream" } });
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { done, value } = await reader.read().catch((cause) => {
        throw new Lost("the service broke off its events", { cause });
      });
      if (done) return;
      clearTimeout(timer);
      timer = setTimeout(stop, SILENT);
      const events = (rest + value).replaceAll("\r\n", "\n").split("\n\n");
      rest = events.pop();
      for (const event of events) {
        const { name, data } = parse(event);
        if (name === "job") changed(JSON.parse(data));
      }
    }
  } finally {
    stop(); // closes it, also where what was told threw
    clearTimeout(timer);
    signal.removeEventListener("abort", stop);
    document.removeEventListener("visibilitychange", stop);
  }
}

function parse(event) {
  let name = "message";
  const data = [];
  for (const line of event.split("\n")) {
    const [, key, value] = /^([^:]*):? ?(.*)$/.exec(line);
    if (key === "event") name = value;
    if (key === "data") data.push(value);
  }
  return { name, data: data.join("\n") };
}
