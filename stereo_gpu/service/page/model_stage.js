// A stage for one model: first as the cameras saw it, drawn only when something has moved.

const STEP = 0.12; // radians a key press
const FIT = 1.08; // of the model's size, so that it does not touch the frame

/** Put a GLB on a stage in `box`; throws where the browser has no WebGL or the model cannot be read. */
export async function openStage(THREE, box, glb, signal) {
  // Before there is a renderer: a browser has 16 at most, and the view may be left while the model is read.
  const model = await read(THREE, glb);
  signal.throwIfAborted();
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch {
    throw new Error("this browser has no WebGL");
  }
  // Photographs as they are: colours in sRGB, and no lamps on top of the light that they were taken in.
  renderer.outputEncoding = THREE.sRGBEncoding;
  const canvas = renderer.domElement;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The model, to turn with the arrow keys");
  box.replaceChildren(canvas);

  const scene = new THREE.Scene();
  const lamp = new THREE.DirectionalLight(0xffffff, 0.9);
  scene.add(lamp, lamp.target, new THREE.AmbientLight(0xffffff, 0.08), model);
  const { target, depth, half } = measure(THREE, model);
  const camera = new THREE.PerspectiveCamera(40, 1, 0.02 * depth, 60 * depth);
  const controls = new THREE.TrackballControls(camera, canvas);
  Object.assign(controls, { rotateSpeed: 1.5, zoomSpeed: 1.2, panSpeed: 0.6, dynamicDampingFactor: 0.25 });
  const materials = dress(THREE, model);

  let moved = true;
  const redraw = () => (moved = true);
  controls.addEventListener("change", redraw);
  const home = () => {
    controls.reset();
    controls.target.copy(target);
    camera.position.set(0, 0, 0);
    camera.up.set(0, 1, 0);
    camera.lookAt(target);
    redraw();
  };
  const fit = () => {
    const width = Math.max(1, box.clientWidth),
      height = Math.max(1, box.clientHeight);
    camera.aspect = width / height;
    camera.fov = Math.min(120, (360 / Math.PI) * Math.atan(Math.max(half.y, half.x / camera.aspect)));
    camera.updateProjectionMatrix();
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    renderer.setSize(width, height);
    controls.handleResize();
    redraw();
  };
  canvas.addEventListener("webglcontextrestored", redraw); // a phone takes it from a page in the background
  canvas.addEventListener("keydown", (event) => {
    if (turn(THREE, camera, controls.target, event.key)) redraw();
    else if (event.key === "Home") home();
    else return;
    event.preventDefault();
  });
  const watch = new ResizeObserver(fit);
  watch.observe(box);
  home();
  fit();
  let frame = 0;
  const draw = () => {
    frame = requestAnimationFrame(draw);
    controls.update();
    if (!moved) return;
    moved = false;
    // Over the left shoulder: light from the camera itself would show no relief.
    camera.updateMatrixWorld();
    lamp.position.set(-0.6 * depth, 0.7 * depth, 0).applyMatrix4(camera.matrixWorld);
    lamp.target.position.copy(controls.target);
    renderer.render(scene, camera);
  };
  draw();
  signal.addEventListener(
    "abort",
    () => {
      cancelAnimationFrame(frame);
      watch.disconnect();
      controls.dispose();
      for (const each of materials) each.free();
      renderer.dispose();
      renderer.forceContextLoss();
    },
    { once: true },
  );
  const show = (how) => {
    for (const each of materials) each.part.material = each[how];
    redraw();
  };
  return { home, show };
}

function read(THREE, glb) {
  const loader = new THREE.GLTFLoader();
  // Through an image rather than a fetch of its blob: address, which the page's policy does not let connect.
  loader.register((parser) => {
    parser.textureLoader = new THREE.TextureLoader(parser.options.manager);
    return { name: "texture_by_image" };
  });
  return new Promise((resolve, reject) =>
    loader.parse(
      glb,
      "",
      ({ scene }) => resolve(scene),
      (error) => reject(new Error(`the model cannot be read: ${error.message}`)),
    ),
  );
}

/** Where the model is, and the tangents of the angles that hold it, seen from the left camera at the origin. */
function measure(THREE, model) {
  const box = new THREE.Box3().setFromObject(model);
  const depth = -box.getCenter(new THREE.Vector3()).z;
  const seen = new THREE.Box3();
  const point = new THREE.Vector3();
  model.traverse((part) => {
    const places = part.isMesh && part.geometry.attributes.position;
    for (let index = 0; places && index < places.count; index++) {
      point.fromBufferAttribute(places, index);
      seen.expandByPoint(point.multiplyScalar(-1 / point.z));
    }
  });
  const target = seen.getCenter(new THREE.Vector3()).multiplyScalar(depth);
  const half = seen.getSize(new THREE.Vector3()).multiplyScalar(FIT / 2);
  return { target, depth, half };
}

/** Three ways to see every part of the model. */
function dress(THREE, model) {
  const dressed = [];
  model.traverse((part) => {
    if (!part.isMesh) return;
    const photo = new THREE.MeshBasicMaterial({ map: part.material.map, side: THREE.DoubleSide });
    const clay = new THREE.MeshPhongMaterial({
      color: 0x96918a,
      shininess: 0,
      flatShading: true,
      side: THREE.DoubleSide,
    });
    const wire = new THREE.MeshBasicMaterial({ color: 0x5b7fb5, wireframe: true });
    part.material.dispose();
    part.material = photo;
    const free = () => [part.geometry, photo, photo.map, clay, wire].forEach((each) => each?.dispose());
    dressed.push({ part, photo, clay, wire, free });
  });
  return dressed;
}

function turn(THREE, camera, target, key) {
  const away = camera.position.clone().sub(target);
  const up = camera.up.clone().normalize();
  const side = up.clone().cross(away).normalize();
  if (key === "ArrowLeft" || key === "ArrowRight") away.applyAxisAngle(up, key === "ArrowLeft" ? -STEP : STEP);
  else if (key === "ArrowUp" || key === "ArrowDown") {
    const angle = key === "ArrowUp" ? -STEP : STEP;
    away.applyAxisAngle(side, angle);
    camera.up.applyAxisAngle(side, angle);
  } else if (key === "+" || key === "=") away.multiplyScalar(0.9);
  else if (key === "-" || key === "−") away.multiplyScalar(1.1);
  else return false;
  camera.position.copy(target).add(away);
  camera.lookAt(target);
  return true;
}
