"""For schemathesis, in tests/test_service_schema.py: what no schema can say is put into requests that are to succeed.

A schema says that a field is a picture or an id; that the picture shows something, and whose id it is, comes from here.
"""

import json
import os
from pathlib import Path

import schemathesis
from schemathesis.transport.serialization import Binary

GIVEN = json.loads(os.environ.get("STEREO_GPU_SCHEMA_GIVEN", "{}"))
NAMES = {"files": "model.glb", "inputs": "left.png", "steps": "rectified.jpg"}


@schemathesis.hook
def map_case(context, case):
    """Pictures, rigs and ids that there are."""
    if case.meta is None or case.meta.generation.mode is not schemathesis.GenerationMode.POSITIVE:
        return case
    folder = Path(GIVEN["folder"])
    left, right, rig = (Binary((folder / name).read_bytes()) for name in ("left.png", "right.png", "rig.json"))
    if isinstance(case.body, dict):
        if case.path == "/v1/rigs":
            case.body |= {"file": [rig]}
        if case.path in ("/v1/jobs", "/v1/outlines"):
            case.body |= {"left": left, "right": right, "rig": GIVEN["rig"]}
            case.body.pop("mask", None)
        if case.path == "/v1/calibrations":
            case.body |= {"left": [left] * 3, "right": [right] * 3}
    # What was made on the way is followed by its own id; and what is given is not deleted.
    if case.meta.phase.name != "stateful" and case.method != "DELETE" and "id" in (case.path_parameters or {}):
        case.path_parameters["id"] = GIVEN[case.path.split("/")[2]]
        if "name" in case.path_parameters:
            case.path_parameters["name"] = NAMES[case.path.split("/")[4]]
    # Asked for again, it has been judged anew, by a schema for which bytes are no string.
    case.meta.generation.mode = schemathesis.GenerationMode.POSITIVE
    return case
