// Pictures behind the token: fetched as blobs, and let go with the view that shows them.

import { getBlob, Refused } from "./api.js";
import { make } from "./dom.js";

/** A picture of the service; says in its place what went wrong, if something does. */
export function picture(path, alt, signal, attributes = {}) {
  const image = make("img", { alt, ...attributes });
  (async () => {
    try {
      show(image, await getBlob(path, signal), signal);
    } catch (error) {
      if (signal.aborted) return;
      image.alt = error instanceof Refused ? `${alt}: ${error.message}` : alt;
    }
  })();
  return image;
}

/** Show a blob in an image for as long as `signal` is not aborted. */
export function show(image, blob, signal) {
  const address = URL.createObjectURL(blob);
  if (image.src.startsWith("blob:")) URL.revokeObjectURL(image.src);
  image.src = address;
  signal?.addEventListener("abort", () => URL.revokeObjectURL(address), { once: true });
}
