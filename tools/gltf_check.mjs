// node tools/gltf_check.mjs FILE.glb...: what the Khronos glTF validator says; status 1 for an error or a warning.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(new URL("../.gltf_check/", import.meta.url));
let validator;
try {
  validator = require("gltf-validator");
} catch {
  console.error("gltf_check: there is no validator here: run tools/gltf_check --install");
  process.exit(2);
}
const SEVERITIES = ["error", "warning", "information", "hint"];
const files = process.argv.slice(2);
if (!files.length) {
  console.error("usage: tools/gltf_check [--install] FILE.glb...");
  process.exit(2);
}
let failed = false;
for (const file of files) {
  let found;
  try {
    found = (await validator.validateBytes(new Uint8Array(readFileSync(file)), { uri: file })).issues;
  } catch (error) {
    console.log(`${file}: cannot be checked: ${error.message ?? error}`);
    failed = true;
    continue;
  }
  failed ||= found.numErrors + found.numWarnings > 0;
  console.log(`${file}: ${found.numErrors} errors, ${found.numWarnings} warnings`);
  for (const { severity, code, message, pointer } of found.messages) {
    console.log(`  ${SEVERITIES[severity]} ${code} at ${pointer ?? "the file"}: ${message}`);
  }
}
process.exit(failed ? 1 : 0);
