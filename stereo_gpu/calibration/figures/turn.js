// Turns the scene that space.py drew: every part carries its points, and `data-view` says how it was looked at.
(function () {
  "use strict";
  const scene = document.querySelector("svg.space");
  if (!scene) return;
  const [mx, my, mz, radius, yaw0, pitch0, eye, fill] = scene.dataset.view.split(" ").map(Number);
  const [, , width, height] = scene.getAttribute("viewBox").split(" ").map(Number);
  const things = [...scene.children].map((element) => ({
    element,
    kind: element.dataset.kind,
    layer: Number(element.dataset.layer),
    points: element.dataset.points.split(" ").map((point) => {
      const [x, y, z] = point.split(",").map(Number);
      return [(x - mx) / radius, (y - my) / radius, (z - mz) / radius];
    }),
  }));
  let yaw = yaw0;
  let pitch = pitch0;
  let scale = 1;
  let place = [0, 0];

  const look = ([x, y, z]) => {
    const across = x * Math.cos(yaw) + z * Math.sin(yaw);
    const away = z * Math.cos(yaw) - x * Math.sin(yaw);
    const down = y * Math.cos(pitch) - away * Math.sin(pitch);
    const depth = away * Math.cos(pitch) + y * Math.sin(pitch);
    const near = scale / (eye + depth);
    return [place[0] + near * across, place[1] + near * down, depth];
  };
  // Lets the scene fill the drawing from where it is looked at now.
  const fit = () => {
    [scale, place] = [1, [0, 0]];
    const seen = things.flatMap((thing) => thing.points.map(look));
    const ends = [0, 1].map((axis) => seen.map((point) => point[axis])).map((v) => [Math.min(...v), Math.max(...v)]);
    scale = fill * Math.min(...ends.map(([low, high], axis) => [width, height][axis] / (high - low)));
    place = ends.map(([low, high], axis) => [width, height][axis] / 2 - (scale * (low + high)) / 2);
  };
  const pair = ([x, y]) => x.toFixed(1) + " " + y.toFixed(1);
  const draw = () => {
    for (const thing of things) {
      const seen = thing.points.map(look);
      thing.depth = seen.reduce((sum, point) => sum + point[2], 0) / seen.length;
      if (thing.kind === "words") {
        thing.element.setAttribute("x", seen[0][0].toFixed(1));
        thing.element.setAttribute("y", seen[0][1].toFixed(1));
      } else if (thing.kind === "line") {
        thing.element.setAttribute("d", seen.map((point, i) => (i % 2 ? "L" : "M") + pair(point)).join(""));
      } else {
        thing.element.setAttribute("d", "M" + seen.map(pair).join("L") + "z");
      }
    }
    things.sort((a, b) => a.layer - b.layer || b.depth - a.depth);
    scene.append(...things.map((thing) => thing.element));
  };
  const turn = (right, down) => {
    yaw += right;
    pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, pitch + down));
    draw();
  };

  // Not movementX, which some browsers leave at zero for fingers.
  let last = [0, 0];
  scene.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    scene.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
  });
  scene.addEventListener("pointermove", (event) => {
    if (!scene.hasPointerCapture(event.pointerId)) return;
    turn((last[0] - event.clientX) / 150, (event.clientY - last[1]) / 150);
    last = [event.clientX, event.clientY];
  });
  const keys = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
  scene.addEventListener("keydown", (event) => {
    if (!(event.key in keys)) return;
    event.preventDefault();
    turn(...keys[event.key]);
  });
  const bar = document.querySelector(".space-bar");
  const views = { first: [yaw0, pitch0], above: [0, Math.PI / 2], side: [Math.PI / 2, 0], behind: [0, 0] };
  bar.addEventListener("click", (event) => {
    const { view, zoom: factor } = event.target.dataset;
    if (view) {
      [yaw, pitch] = views[view];
      fit();
    } else if (factor) {
      scale *= Number(factor);
      place = place.map((at, axis) => [width, height][axis] / 2 + (at - [width, height][axis] / 2) * Number(factor));
    } else return;
    draw();
  });
  fit();
  bar.hidden = false;
})();
