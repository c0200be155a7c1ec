// Requests with the token; every error as one line.

import { found, pause, reached, waiting } from "./connection.js";
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
    const sent = token();
    let answer;
    try {
      answer = await fetch(path, {
        method,
        body,
        signal,
        cache: "no-store",
        credentials: "omit",
        redirect: "error",
        headers: { ...headers, Authorization: `Bearer ${sent}` },
      });
    } catch (error) {
      if (signal?.aborted) throw signal.reason;
      throw new Lost("the connection broke off: is the service running, and does nothing before it refuse this?", {
        cause: error,
      });
    }
    found();
    if (answer.status === 401) {
      if (token() !== sent) continue; // another request asked meanwhile
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

/** Whether it may go better a moment later: a lost connection, and what says that the service stops or is busy. */
export const passing = (error) =>
  error instanceof Lost || (error instanceof Refused && [502, 503, 504].includes(error.status));

/**
 * Do something that may safely be done twice, until the service answers.
 *
 * Where only this breaks off, and the service answers otherwise, something between is against it: that is told at last.
 */
export async function persist(once, signal) {
  let broken = 0;
  for (let tries = 0; ; tries++) {
    try {
      return await once();
    } catch (error) {
      if (!passing(error)) throw error;
      if (error instanceof Lost && (await reached()) && ++broken >= MOST_BROKEN) throw error;
      await pause(error.retrySeconds ? 1000 * error.retrySeconds : waiting(tries), signal);
    }
  }
}

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

/**
 * A sender of one form, which gives the job that the service made of it.
 *
 * The same values sent again, after a lost connection or by another press after an error, have the same key, by which
 * the service makes one job of them; a text is the same if it reads the same, a file if it is the same one.
 */
export function jobSender(path) {
  let last = { values: [], key: "" };
  return async (form, values) => {
    if (values.length !== last.values.length || values.some((value, index) => value !== last.values[index]))
      last = { values, key: newKey() };
    const headers = { "Idempotency-Key": last.key };
    const job = await persist(async () => body(await send(path, { method: "POST", body: form, headers }), "json"));
    last = { values: [], key: "" }; // pressed once more it is another job
    return job;
  };
}

function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
