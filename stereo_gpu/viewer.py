"""A page that shows a textured mesh to turn, offline: three.js as trimesh brings it, with our own stage."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import logging
import zipfile
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.drawing.orbit import orbit, spread
from stereo_gpu.errors import StageError
from stereo_gpu.model_files.frame import METRES_SHOWN
from stereo_gpu.model_files.gltf import pack_glb
from stereo_gpu.types import Mesh

log = logging.getLogger(__name__)

_TEXTURE_SIDE = 2048  # px: what a phone can hold, and enough for a window on a page
_TEXTURE_QUALITY = 88
_TEMPLATE = ("resources", "templates", "viewer.zip")  # within trimesh
# From here on trimesh's page is its own stage: white, lit, and turning about the middle of the bounding box.
_STAGE = "var camera,controls,scene,renderer,tracklight;"
_BODY = """<style>
html, body { margin: 0; height: 100%; overflow: hidden; background: radial-gradient(#fafbfc, #d9dee5);
  font: 13px/1.4 system-ui, sans-serif; color: #1d2430; color-scheme: light dark; }
#container.said { padding: 2rem; }
canvas { display: block; cursor: grab; touch-action: none; }
canvas:active { cursor: grabbing; }
#bar { position: absolute; left: 8px; bottom: 8px; display: flex; flex-wrap: wrap; gap: 6px; }
#bar[hidden] { display: none; }
button { font: inherit; padding: 4px 12px; border-radius: 999px; border: 1px solid #8a94a366;
  background: #ffffffd9; color: inherit; cursor: pointer; }
button[aria-pressed=true] { background: #2a5db0; border-color: #2a5db0; color: #fff; }
@media (prefers-color-scheme: dark) {
  html, body { background: radial-gradient(#3a4048, #1b1e23); color: #e8eaee; }
  button { background: #2a2f37d9; }
}
</style>
<div id="bar" hidden>
<button data-how="photo" aria-pressed="true">Texture</button>
<button data-how="clay" aria-pressed="false">Shape</button>
<button data-how="wire" aria-pressed="false">Wires</button>
<button id="front">Front view</button>
</div>
"""


def viewer_page(mesh: Mesh) -> str:
    """Return a whole HTML page, as text, that shows the mesh first from where the cameras stood.

    Raises:
        StageError: the mesh has no face in front of the cameras.
    """
    vertices = mesh.vertices.astype(np.float64)
    drawable = np.isfinite(vertices).all(axis=1) & (vertices[:, 2] > 0)
    faces = mesh.faces[np.all(drawable[mesh.faces], axis=1)]
    if not len(faces):
        raise StageError(f"none of {len(mesh.faces)} faces can be shown: mesh a larger part of the disparity")
    glb = pack_glb(_with_small_texture(mesh), texture_format="jpeg", quality=_TEXTURE_QUALITY)
    library, found, _ = _library().partition(_STAGE)
    if not found:
        log.warning("trimesh's viewer page has changed: the report shows the model on trimesh's own stage")
        return _page_of_trimesh(glb)
    size = (400, 300)
    camera = orbit(spread(vertices, faces), size)
    scale = METRES_SHOWN[mesh.unit]
    depth = float(camera.pivot[2]) * scale
    ray = ((np.array(size) - 1) / 2 - camera.centre) / camera.focal
    stage = {
        "target": [float(ray[0]) * depth, float(-ray[1]) * depth, -depth],
        "depth": depth,
        "halfWidth": size[0] / 2 / camera.focal,
        "halfHeight": size[1] / 2 / camera.focal,
    }
    script = Path(__file__).with_name("viewer.js").read_text(encoding="utf-8")
    own = f'const glb="{base64.b64encode(glb).decode()}";\nconst stage={json.dumps(stage)};\n{script}'
    return f"{library}</script>\n{_BODY}<script>\n{own}</script></body>\n</html>\n"


def viewer_script() -> str:
    """three.js with GLTFLoader and TrackballControls, as a classic script; "" where trimesh brings none any more."""
    library, found, _ = _library().partition(_STAGE)
    return library.partition("<script>")[2] if found else ""


def _library() -> str:
    """The page that trimesh makes viewers of, three.js within; "" where it is not in its place any more.

    It is read without importing trimesh, which takes a tenth of a second and more.
    """
    found = find_spec("trimesh")
    for folder in (found.submodule_search_locations or ()) if found else ():
        try:
            with zipfile.ZipFile(Path(folder, *_TEMPLATE)) as archive:
                return archive.read("viewer.html.template").decode()
        except (OSError, KeyError, zipfile.BadZipFile):
            continue
    return ""


def _page_of_trimesh(glb: bytes) -> str:
    import trimesh
    from trimesh.viewer import scene_to_html

    return str(scene_to_html(trimesh.load_scene(io.BytesIO(glb), file_type="glb")))


def _with_small_texture(mesh: Mesh) -> Mesh:
    """With a texture that a phone can hold."""
    height, width = mesh.texture.shape[:2]
    largest = max(height, width)
    if largest <= _TEXTURE_SIDE:
        return mesh
    size = (max(1, round(width * _TEXTURE_SIDE / largest)), max(1, round(height * _TEXTURE_SIDE / largest)))
    small = cv2.resize(mesh.texture, size, interpolation=cv2.INTER_AREA)
    return dataclasses.replace(mesh, texture=np.asarray(small, np.uint8))
