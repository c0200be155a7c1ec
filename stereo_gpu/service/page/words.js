// How things are called on the page.

const STAGES = {
  read: "Read the pictures",
  rig: "Read the rig",
  check: "Check the rig",
  rectify: "Rectify",
  mask: "Mask",
  range: "Find the range of disparities",
  match: "Match",
  close: "Close holes",
  triangulate: "Triangulate",
  mesh: "Make the mesh",
  smooth: "Smooth",
  decimate: "Decimate",
  unwrap: "Unwrap",
  texture: "Texture",
  save: "Save",
  find: "Find the board in the pictures",
  fit: "Fit the cameras",
  report: "Draw the report",
};
const STEPS = {
  rectified: "Rectified pair",
  masked: "Masked",
  disparity: "Disparity",
  points: "Points",
  mesh: "Mesh",
  smoothed: "Smoothed mesh",
  textured: "Textured model",
};
const FILES = {
  "rig.json": "The rig",
  "model.glb": "Model with its texture, for viewers, Blender, the web",
  "report.html": "Report with all pictures, opens offline",
  "model.obj": "Model for older programs; needs the .mtl and the .png",
  "model.mtl": "Material of model.obj",
  "model.png": "Texture of model.obj and model.ply",
  "model.ply": "Model for MeshLab",
  "cloud.ply": "Coloured points",
  "surface.vtp": "Surface for ParaView",
  "disparity.pfm": "Disparities as numbers",
  "disparity.png": "Disparities in colours",
  "result.json": "Options, times and counts",
  "calibration.json": "Errors of each view, advice",
  "coverage-left.svg": "Drawing",
  "coverage-right.svg": "Drawing",
  "arrows-left.svg": "Drawing",
  "arrows-right.svg": "Drawing",
};
const STATES = { queued: "waiting", running: "running", done: "done", failed: "failed", cancelled: "cancelled" };

/** A name as words: its own, or the name with spaces. */
const known = (table, name) => table[name] ?? plain(name);
const plain = (name) => (name.charAt(0).toUpperCase() + name.slice(1)).replaceAll("_", " ");

export const stageWords = (name) => known(STAGES, name);
export const stepWords = (name) => known(STEPS, name);
export const fileWords = (name) => FILES[name] ?? "";
/** Where a file stands in a list: those with words in their order, the others last. */
export const fileOrder = (name) => (name in FILES ? Object.keys(FILES).indexOf(name) : 99);
export const stateWords = (name) => STATES[name] ?? name;

/** A number of bytes for people. */
export function bytesWords(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  const units = ["kB", "MB", "GB", "TB"];
  let value = bytes / 1000,
    unit = 0;
  while (value >= 999.5 && unit < units.length - 1) [value, unit] = [value / 1000, unit + 1];
  return `${value.toFixed(value < 10 ? 1 : 0)} ${units[unit]}`;
}

/** Seconds for people. */
export function secondsWords(seconds) {
  if (seconds < 10) return `${seconds.toFixed(2)} s`;
  if (seconds < 120) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

/** A moment, in the reader's own way. */
export const momentWords = (text) =>
  new Date(text).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });

/** What a job is called. */
export const jobName = (job) =>
  job.label || `${job.kind === "calibration" ? "Calibration" : "Model"} ${job.id.slice(0, 8)}`;
