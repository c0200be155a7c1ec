// Whether the service answers: one line on top of the page while it does not, and pauses that grow until it does.

const FIRST = 500,
  LONGEST = 8000; // ms

let watched = false;

const line = () => document.getElementById("connection");

/** Say that the service was reached. */
export function found() {
  if (!line().hidden) line().hidden = true;
}

/** Whether the service answers at all, after a request that broke off; if not, the line says so until it does. */
export async function reached() {
  const answers = await alive();
  if (answers) found();
  else lost();
  return answers;
}

async function lost() {
  line().textContent = "The service cannot be reached. The page goes on by itself as soon as it answers again.";
  line().hidden = false;
  if (watched) return;
  watched = true; // here, since whoever met it may have been left, and asks no more
  for (let tries = 0; !line().hidden; tries++) {
    await pause(waiting(tries));
    if (await alive()) found();
  }
  watched = false;
}

const alive = () =>
  fetch("/healthz", { cache: "no-store", credentials: "omit" }).then(
    ({ ok }) => ok,
    () => false,
  );

/** A pause; ends early when the browser is back on the net, and throws when `signal` is aborted. */
export function pause(milliseconds, signal) {
  return new Promise((resolve, reject) => {
    const end = () => {
      clearTimeout(timer);
      window.removeEventListener("online", end);
      signal?.removeEventListener("abort", end);
      if (signal?.aborted) reject(signal.reason);
      else resolve();
    };
    const timer = setTimeout(end, milliseconds);
    window.addEventListener("online", end);
    signal?.addEventListener("abort", end);
    if (signal?.aborted) end();
  });
}

/** The pause before the n-th try, from 0. */
export const waiting = (tries) => Math.min(LONGEST, FIRST * 2 ** tries);
