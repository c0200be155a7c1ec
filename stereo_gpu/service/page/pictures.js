// Pictures behind the token: fetched as blobs, and let go with the view that shows them.

import { getBlob, Refused } from "./api.js";
import { make } from "./dom.js";

/**
 * A picture of the service; says in its place what went wrong, if something does.
 *
 * A lazy one is fetched when it comes near to what is seen.
 */
export function picture(path, alt, signal, { lazy = false } = {}) {
  const image = make("img", { alt });
  (async () => {
    try {
      if (lazy) await near(image, signal);
      const blob = await getBlob(path, signal);
      signal.throwIfAborted();
      const address = URL.createObjectURL(blob);
      signal.addEventListener("abort", () => URL.revokeObjectURL(address), { once: true });
      image.src = address;
    } catch (error) {
      if (signal.aborted) return;
      image.classList.add("failed");
      image.alt = error instanceof Refused ? `${alt}: ${error.message}` : alt;
    }
  })();
  return image;
}

function near(image, signal) {
  return new Promise((resolve, reject) => {
    const watch = new IntersectionObserver(
      (entries) => {
        if (!entries.some((entry) => entry.isIntersecting)) return;
        watch.disconnect();
        resolve();
      },
      { rootMargin: "300px" },
    );
    watch.observe(image);
    signal.addEventListener(
      "abort",
      () => {
        watch.disconnect();
        reject(signal.reason);
      },
      { once: true },
    );
  });
}
