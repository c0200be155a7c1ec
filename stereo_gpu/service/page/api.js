// Requests with the token; every error as one line.

import { found, lost, pause, waiting } from "./connection.js";
import { askToken, token } from "./session.js";

const MOST_BROKEN = 4; // times that a request breaks off while the service answers others

/** The service refused a request, and says why. */
export class Refused extends Error {
  constructor(status, detail, retrySeconds) {
    super(detail);
    this.status = status;
    this.retrySeconds = retrySeconds;
  }
}

/** The service was not reached, or broke off. */
export class Lost extends Error {}

/**
 * One request; the answer is one of 200 to 299.
 *
 * A wrong token is asked for again, however often. Throws Refused, Lost, or what `signal` was aborted with.
 */
export async function send(path, { method = "GET", body, headers = {}, signal } = {}) {
  for (;;) {
    if (!token()) await askToken();
    let answer;
    try {
      answer = await fetch(path, {
        method,
        body,
        signal,
        cache: "no-store",
        credentials: "omit",
        redirect: "error",
        headers: { ...headers, Authorization: `Bearer ${token()}` },
      });
    } catch (error) {
      if (signal?.aborted) throw signal.reason;
      throw new Lost("the connection broke off: is the service running, and does nothing before it refuse this?", {
        cause: error,
      });
    }
    found();
    if (answer.status === 401) {
      await askToken("This token is not known to the service. Give the one that it printed when it first started.");
      continue;
    }
    if (answer.ok) return answer;
    throw await refusal(answer);
  }
}

async function refusal(answer) {
  let detail = `${answer.status} ${answer.statusText}`.trim();
  try {
    const problem = await answer.json();
    detail = problem.detail || problem.title || detail;
  } catch {
    // not the service itself, but a proxy before it
  }
  const retry = Number(answer.headers.get("Retry-After"));
  return new Refused(answer.status, detail, retry > 0 ? retry : null);
}

/**
 * Do something that may safely be done twice, until the service answers.
 *
 * `once` is tried again after a lost connection, and after a 503, which says that the service is about to stop or busy.
 * Where only this breaks off, and the service answers otherwise, something between is against it: that is told at last.
 */
export async function persist(once, signal) {
  let broken = 0;
  for (let tries = 0; ; tries++) {
    try {
      return await once();
    } catch (error) {
      const busy = error instanceof Refused && [502, 503, 504].includes(error.status);
      if (!busy && !(error instanceof Lost)) throw error;
      if (!busy && (await alive(signal)) && ++broken >= MOST_BROKEN) throw error;
      if (!busy) lost();
      await pause(busy && error.retrySeconds ? 1000 * error.retrySeconds : waiting(tries), signal);
    }
  }
}

/** Whether the service answers at all. */
const alive = (signal) =>
  fetch("/healthz", { cache: "no-store", credentials: "omit", signal }).then(
    ({ ok }) => ok,
    () => false,
  );

/** The JSON at a path, however long that takes. */
export const getJson = (path, signal) =>
  persist(async () => body(await send(path, { signal }), "json", signal), signal);

/** What lies at a path, as a blob, however long that takes. */
export const getBlob = (path, signal) =>
  persist(async () => body(await send(path, { signal }), "blob", signal), signal);

/** The body of an answer; a connection that breaks amid it is a lost one. */
export async function body(answer, kind, signal) {
  try {
    return await answer[kind]();
  } catch (error) {
    if (signal?.aborted) throw signal.reason;
    throw new Lost("the service broke off amid its answer", { cause: error });
  }
}

/** A key for one wish, by which the service knows it again. */
export function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
