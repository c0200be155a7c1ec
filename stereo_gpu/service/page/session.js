// The token: from the link's fragment, which no server sees; kept as long as the tab is open; else asked for.

const PLACE = "stereo-gpu-token";
let kept = null; // where the browser keeps nothing, as in some private windows
let asking = null;

/** Take the token out of the address, so that it is neither seen nor kept in the history. */
export function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!given) return;
  keep(given);
  history.replaceState(null, "", `${location.pathname}#/new`);
}

/** The token, or null. */
export function token() {
  try {
    return sessionStorage.getItem(PLACE) ?? kept;
  } catch {
    return kept;
  }
}

function keep(given) {
  kept = given;
  try {
    sessionStorage.setItem(PLACE, given);
  } catch {
    // `kept` has it
  }
}

/** Ask for a token; one question for all who wait. */
export function askToken(why) {
  asking ??= new Promise((resolve) => {
    const dialog = document.getElementById("ask");
    const input = document.getElementById("ask-token");
    if (why) document.getElementById("ask-why").textContent = why;
    input.value = "";
    const stay = (event) => event.preventDefault(); // Escape would leave a page that can do nothing
    const done = () => {
      dialog.removeEventListener("cancel", stay);
      keep(input.value.trim());
      asking = null;
      resolve();
    };
    dialog.addEventListener("cancel", stay);
    dialog.addEventListener("close", done, { once: true });
    dialog.showModal();
    input.focus();
  });
  return asking;
}
