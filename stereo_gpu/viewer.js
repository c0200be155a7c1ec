// Shows one textured model, first as the cameras saw it. Runs after three.js r140, GLTFLoader and
// TrackballControls, which come from trimesh's viewer; `glb` is base64 and `stage` is set by viewer.py.
(function () {
  "use strict";
  const box = document.getElementById("container");
  const say = (text) => {
    box.textContent = text;
    box.className = "said";
  };
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch (error) {
    // In the report the rest of the frame would be a large empty field.
    if (window.frameElement) {
      window.frameElement.style.aspectRatio = "auto";
      window.frameElement.style.height = "6rem";
    }
    say("This browser has no WebGL, so the model cannot be turned here. “Turned” below shows it as it turns; or open" +
      " model.glb in another viewer.");
    return;
  }
  // Paint photographs as they are: colours in sRGB, and no lamps on top of the light that they were taken in.
  renderer.outputEncoding = THREE.sRGBEncoding;
  box.appendChild(renderer.domElement);

  const scene = new THREE.Scene();
  const lamp = new THREE.DirectionalLight(0xffffff, 0.9);
  scene.add(lamp, new THREE.AmbientLight(0xffffff, 0.08));
  const camera = new THREE.PerspectiveCamera(40, 1, 0.02 * stage.depth, 60 * stage.depth);
  const controls = new THREE.TrackballControls(camera, renderer.domElement);
  controls.rotateSpeed = 1.5;
  controls.zoomSpeed = 1.2;
  controls.panSpeed = 0.6;
  controls.dynamicDampingFactor = 0.25;

  const target = new THREE.Vector3(...stage.target);
  const home = () => {
    controls.reset();
    controls.target.copy(target);
    camera.position.set(0, 0, 0);
    camera.up.set(0, 1, 0);
    camera.lookAt(target);
  };

  // The frame that holds the model from the front must fit whatever the shape of the window.
  const fit = () => {
    const width = Math.max(1, window.innerWidth);
    const height = Math.max(1, window.innerHeight);
    camera.aspect = width / height;
    const half = Math.max(stage.halfHeight, stage.halfWidth / camera.aspect);
    camera.fov = (360 / Math.PI) * Math.atan(half);
    camera.updateProjectionMatrix();
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    renderer.setSize(width, height);
    controls.handleResize();
  };

  // Until somebody takes hold of it the model sways a little, for that shows at once that it has depth.
  let swaying = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const started = performance.now();
  const rest = () => { swaying = false; };
  for (const name of ["pointerdown", "wheel"]) {
    renderer.domElement.addEventListener(name, rest, { capture: true, passive: true });
  }
  const sway = () => {
    const seconds = (performance.now() - started) / 1000;
    if (seconds > 12) return rest(); // two whole swings: back where it began
    const angle = 0.11 * Math.sin((seconds * Math.PI) / 3);
    const back = target.clone().negate();
    camera.position.copy(target).add(back.applyAxisAngle(new THREE.Vector3(0, 1, 0), angle));
    camera.lookAt(target);
  };
  const draw = () => {
    requestAnimationFrame(draw);
    if (swaying) sway();
    else controls.update();
    // Over the left shoulder: light from the camera itself would show no relief.
    lamp.position.set(-0.6 * stage.depth, 0.7 * stage.depth, 0).applyMatrix4(camera.matrixWorld);
    lamp.target.position.copy(controls.target);
    lamp.target.updateMatrixWorld();
    renderer.render(scene, camera);
  };

  const bytes = Uint8Array.from(atob(glb), (letter) => letter.charCodeAt(0));
  new THREE.GLTFLoader().parse(
    bytes.buffer,
    "",
    (model) => {
      const clay = new THREE.MeshPhongMaterial({
        color: 0x96918a, shininess: 0, flatShading: true, side: THREE.DoubleSide,
      });
      const painted = [];
      model.scene.traverse((part) => {
        if (!part.isMesh) return;
        const photo = new THREE.MeshBasicMaterial({ map: part.material.map, side: THREE.DoubleSide });
        painted.push({ part, photo, wire: new THREE.MeshBasicMaterial({ color: 0x5b7fb5, wireframe: true }) });
        part.material = photo;
      });
      scene.add(model.scene);
      const show = (how) => {
        for (const { part, photo, wire } of painted) part.material = { photo, clay, wire }[how];
        for (const button of document.querySelectorAll("button[data-how]")) {
          button.setAttribute("aria-pressed", String(button.dataset.how === how));
        }
      };
      for (const button of document.querySelectorAll("button[data-how]")) {
        button.addEventListener("click", () => show(button.dataset.how));
      }
      document.getElementById("front").addEventListener("click", () => {
        rest();
        home();
      });
      document.getElementById("bar").hidden = false;
      home();
      fit();
      window.addEventListener("resize", fit);
      draw();
    },
    (error) => say("The model cannot be read: " + error.message),
  );
})();
