// Pick a rig, or send the file of one.

import { body, getJson, persist, send } from "./api.js";
import { alertLine, button, choice, field, make, say } from "./dom.js";

const words = (rig) => {
  const { width, height, baseline, unit, rms_px: rms } = rig.summary ?? rig;
  const facts = [
    width && `${width} × ${height} px`,
    baseline && `${Number(baseline.toPrecision(4))} ${unit ?? ""} apart`.trim(),
    rms && `error ${rms.toFixed(2)} px`,
  ].filter(Boolean);
  return [rig.name || rig.id.slice(0, 8), ...facts].join(" · ");
};

/** A list of this client's rigs, with a place to send one; `changed(id)` is told which one is chosen. */
export function rigPicker(changed) {
  const list = make("select", { change: () => choose(list.value) });
  const file = make("input", {
    type: "file",
    multiple: true,
    accept: ".json,.yml,.yaml,.xml,.mat,.txt",
    change: upload,
  });
  const stay = (event) => event.key === "Enter" && event.preventDefault(); // it would start the job
  const size = make("input", { type: "text", placeholder: "640x480", autocomplete: "off", keydown: stay });
  const unit = choice(
    [["", "what the file says, else mm"], ...["mm", "cm", "m", "in"].map((name) => [name, name])],
    "",
  );
  const told = alertLine();
  const remove = button("Delete this rig", drop);
  const state = { id: "", rigs: [] };

  function choose(id) {
    state.id = id;
    list.value = id;
    remove.disabled = !id;
    changed(id);
  }

  async function load(signal, wanted = state.id) {
    const rigs = [];
    // All of them: who has more than a thousand rigs picks one by its address.
    for (let path = "/v1/rigs?limit=100"; path && rigs.length < 1000;) {
      const page = await getJson(path, signal);
      rigs.push(...page.items);
      path = page.next;
    }
    if (wanted && !rigs.some((rig) => rig.id === wanted)) {
      const one = await getJson(`/v1/rigs/${encodeURIComponent(wanted)}`, signal).catch(() => null);
      if (one) rigs.push(one);
    }
    state.rigs = rigs;
    const none = rigs.length ? "Choose a rig" : "There is none yet: send one, or make one";
    list.replaceChildren(
      make("option", { value: "" }, none),
      ...rigs.map((rig) => make("option", { value: rig.id }, words(rig))),
    );
    const chosen = rigs.find((rig) => rig.id === wanted) ?? (rigs.length === 1 ? rigs[0] : null);
    if ((chosen?.id ?? "") !== state.id) choose(chosen?.id ?? "");
    else list.value = state.id; // the same one: what was painted with it stays
  }

  async function upload() {
    const form = new FormData();
    for (const one of file.files) form.append("file", one, one.name);
    form.append("name", file.files[0].name);
    if (size.value.trim()) form.append("size", size.value.trim());
    if (unit.value) form.append("unit", unit.value);
    say(told, "");
    file.disabled = true;
    try {
      const rig = await body(await send("/v1/rigs", { method: "POST", body: form }), "json");
      await load(undefined, rig.id);
    } catch (error) {
      say(told, error.message);
    } finally {
      file.disabled = false;
      file.value = "";
    }
  }

  async function drop() {
    const rig = state.rigs.find(({ id }) => id === state.id);
    if (!rig || !confirm(`Delete the rig ${rig.name || rig.id}? Models made with it stay.`)) return;
    say(told, "");
    try {
      await persist(() => send(`/v1/rigs/${rig.id}`, { method: "DELETE" }));
      await load(undefined, "");
    } catch (error) {
      say(told, error.message);
    }
  }

  remove.disabled = true;
  const element = make(
    "div",
    {},
    field("Rig", list, "How the two cameras stand to each other, from a calibration: depth is measured by it."),
    field(
      "Or send the file of one",
      file,
      "rig.json, or OpenCV's, ROS's, Matlab's, KITTI's or Middlebury's; two that belong together at once.",
    ),
    make(
      "details",
      {},
      make("summary", {}, "Where that file does not say"),
      make(
        "div",
        { class: "columns" },
        field("Size of its pictures, px", size, "Before the file is sent."),
        field("Unit of its lengths", unit),
      ),
    ),
    make(
      "p",
      { class: "buttons" },
      make("a", { class: "button", href: "#/calibrate" }, "Make one from board pictures"),
      remove,
    ),
    told,
  );
  return { element, state, load };
}
