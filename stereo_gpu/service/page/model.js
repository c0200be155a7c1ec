// The model to turn: three.js r140 with GLTFLoader and TrackballControls, as trimesh brings them (/page/three.js).

import { getBlob, Lost, persist, send } from "./api.js";
import { button, make, say } from "./dom.js";
import { picture } from "./pictures.js";
import { openStage } from "./model_stage.js";

const LIBRARY = "/page/three.js";

/** The library, loaded once; throws where it is not to be had. */
async function loadThree(signal) {
  if (!window.THREE) await persist(() => runScript(signal), signal);
  if (!window.THREE) throw new Error("the viewer could not be loaded");
  return window.THREE;
}

async function runScript(signal) {
  const loaded = await new Promise((resolve) =>
    document.head.append(make("script", { src: LIBRARY, load: () => resolve(true), error: () => resolve(false) })),
  );
  if (loaded) return;
  await send(LIBRARY, { method: "HEAD", signal }); // throws what was wrong: refused for good, or lost for now
  throw new Lost("the viewer could not be loaded");
}

/** A frame that shows a GLB to turn, or where that cannot be done its picture. */
export function modelViewer(path, job, signal) {
  const box = make("div", { class: "stage" });
  const told = make("p", { class: "soft", role: "status" }, "Loading the model …");
  const bar = make("p", { class: "buttons", hidden: true });
  const element = make(
    "section",
    { class: "model" },
    make("h2", { class: "unseen" }, "Model"),
    box,
    make("div", { class: "below" }, bar, told),
  );
  (async () => {
    try {
      const [three, blob] = await Promise.all([loadThree(signal), getBlob(path, signal)]);
      const stage = await openStage(three, box, await blob.arrayBuffer(), signal);
      const shows = [
        ["photo", "Texture"],
        ["clay", "Shape"],
        ["wire", "Wires"],
      ].map(([how, text]) => {
        const press = button(
          text,
          () => {
            stage.show(how);
            for (const each of shows) each.setAttribute("aria-pressed", String(each === press));
          },
          { "aria-pressed": String(how === "photo") },
        );
        return press;
      });
      bar.append(...shows, button("Front view", stage.home));
      bar.hidden = false;
      const size = job.summary?.triangles ? `${job.summary.triangles.toLocaleString()} triangles. ` : "";
      say(
        told,
        `${size}Drag to turn, wheel or two fingers to zoom; with keys: arrows turn, + and − zoom, Home goes back.`,
      );
    } catch (error) {
      if (signal.aborted) return;
      const textured = (job.steps ?? []).find(({ name }) => name === "textured");
      box.classList.add("flat");
      box.replaceChildren(...(textured ? [picture(textured.href, "The textured model", signal)] : []));
      say(
        told,
        `The model cannot be turned here (${error.message}). Download model.glb and open it in another viewer.`,
      );
    }
  })();
  return element;
}
