// The options of a reconstruction: the ones that matter first, the rest in a part that opens.

import { choice, field, make } from "./dom.js";

const PROFILES = [
  ["precise", "Precise: the best surface"],
  ["fast", "Fast: a good one at once"],
  ["paper", "As in the paper, plain"],
];

const number = (attributes = {}) => make("input", { type: "number", step: "any", inputmode: "decimal", ...attributes });
const whole = (attributes = {}) => number({ step: 1, min: 0, inputmode: "numeric", ...attributes });

/** The options as form fields; `value()` is what to send, without what is left at its default. */
export function optionFields(referenceChanged) {
  const profile = choice(PROFILES, "precise");
  const files = choice(
    [
      ["all", "All: points, map, report too"],
      ["model", "The model alone"],
    ],
    "all",
  );
  const smallest = whole({ placeholder: "auto" }),
    count = whole({ min: 1, placeholder: "auto" });
  const near = number({ min: 0, placeholder: "any" }),
    far = number({ min: 0, placeholder: "any" });
  const window_ = whole({ min: 3, max: 31, step: 2, placeholder: "as the profile says" });
  const reference = choice(
    [
      ["right", "right, as in the paper"],
      ["left", "left"],
    ],
    "right",
    referenceChanged,
  );
  const texture = choice(
    [
      ["png", "PNG, exact"],
      ["jpeg", "JPEG, small"],
      ["webp", "WebP, smallest"],
    ],
    "png",
  );
  const check = choice(
    [
      ["first", "until one pair was right"],
      ["full", "always in full"],
      ["rows", "quickly"],
      ["never", "never"],
    ],
    "first",
  );
  const ignore = make("input", { type: "checkbox" });
  const method = choice(
    [
      ["bounded", "few triangles"],
      ["dense", "two a pixel"],
    ],
    "bounded",
  );
  const mesh = {
    error_px: number({ min: 0, placeholder: "0.25" }),
    max_jump_px: number({ min: 0, placeholder: "3" }),
    largest_hole: whole({ placeholder: "400" }),
    smallest_part: whole({ placeholder: "150" }),
    faces: whole({ placeholder: "50000" }),
    decimate_error: number({ min: 0, placeholder: "none" }),
    smoothing: whole({ max: 1000, placeholder: "10" }),
  };
  const unwrap = choice(
    [
      ["charts", "charts"],
      ["view", "the picture itself"],
    ],
    "charts",
  );

  const element = make(
    "div",
    {},
    make("div", { class: "columns wide" }, field("Quality", profile), field("Files", files)),
    make(
      "details",
      {},
      make("summary", {}, "More options"),
      make(
        "fieldset",
        {},
        make("legend", {}, "Matching"),
        make(
          "div",
          { class: "columns" },
          field("Smallest disparity, px", smallest, "Empty: found from the pair."),
          field("How many disparities", count, "Both or neither."),
          field("Window, px", window_, "Side of the correlation window, odd, 3 to 31."),
          field("Reference picture", reference, "The mesh is laid out on it and textured from it."),
        ),
      ),
      make(
        "fieldset",
        {},
        make("legend", {}, "Depth and rig"),
        make(
          "div",
          { class: "columns" },
          field("Nearest depth", near, "In the rig's unit, mm as a rule."),
          field("Farthest depth", far),
          field("Check the rig", check),
          make("p", { class: "field check" }, make("label", {}, ignore, " Go on where the rig does not fit the pair")),
        ),
      ),
      make(
        "fieldset",
        {},
        make("legend", {}, "Mesh"),
        make(
          "div",
          { class: "columns" },
          field("Method", method),
          field("Error, px", mesh.error_px, "How far the mesh may lie from the map."),
          field("Largest jump, px", mesh.max_jump_px, "Over more than this there is no surface."),
          field("Largest hole, pixels", mesh.largest_hole, "Larger ones stay open; 0 for all of them."),
          field("Smallest part, pixels", mesh.smallest_part, "Smaller ones are dropped."),
          field("Triangles", mesh.faces, "0 for all."),
          field("Decimation error", mesh.decimate_error, "In the rig's unit."),
          field("Smoothing passes", mesh.smoothing),
          field("Unwrap by", unwrap),
          field("Texture of model.glb", texture),
        ),
      ),
    ),
  );

  const end = (input) => (input.value === "" ? null : Number(input.value));

  /** What is chosen; the service says what is wrong with it. */
  function value() {
    const options = { profile: profile.value, files: files.value, steps: true };
    if (check.value !== "first") options.check = check.value;
    if (smallest.value !== "" || count.value !== "") options.disparities = [end(smallest), end(count)];
    if (window_.value !== "") options.window = Number(window_.value);
    if (reference.value !== "right") options.reference = reference.value;
    if (near.value !== "" || far.value !== "") options.depth = [end(near), end(far)];
    if (ignore.checked) options.ignore_check = true;
    if (texture.value !== "png") options.texture_format = texture.value;
    const given = Object.entries(mesh).filter(([, input]) => input.value !== "");
    const shape = Object.fromEntries(given.map(([name, input]) => [name, Number(input.value)]));
    if (method.value !== "bounded") shape.method = method.value;
    if (unwrap.value !== "charts") shape.unwrap = unwrap.value;
    if (Object.keys(shape).length) options.mesh = shape;
    return options;
  }
  return { element, value, reference: () => reference.value };
}
