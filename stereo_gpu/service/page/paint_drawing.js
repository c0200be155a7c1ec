// What the painter's canvas shows: the picture, what is left out of it darkened, the strokes, the hand.

const COLOURS = { wanted: "rgb(60 220 120 / .55)", unwanted: "rgb(255 70 90 / .55)", line: "#ffd23f" };
const SHADE = 0xa5100a08,
  EDGE = 0xff3fd2ff; // dark and half clear; the line's yellow: alpha, blue, green, red

/** A mask as the picture to lay over the view, with the share that is wanted. */
export function maskPicture(bitmap, width, height) {
  const surface = new OffscreenCanvas(width, height);
  const context = surface.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0, width, height);
  const image = context.getImageData(0, 0, width, height);
  const pixels = new Uint32Array(image.data.buffer); // a whole pixel at once: there may be two million
  const inside = new Uint8Array(width * height);
  let count = 0;
  for (let index = 0; index < inside.length; index++) count += inside[index] = (pixels[index] & 255) > 127 ? 1 : 0;
  const reach = Math.max(1, Math.round(Math.max(width, height) / 500));
  for (let y = 0, index = 0; y < height; y++) {
    for (let x = 0; x < width; x++, index++) {
      const here = inside[index];
      const edge =
        here &&
        !(
          inside[y * width + Math.max(0, x - reach)] &&
          inside[y * width + Math.min(width - 1, x + reach)] &&
          inside[Math.max(0, y - reach) * width + x] &&
          inside[Math.min(height - 1, y + reach) * width + x]
        );
      pixels[index] = edge ? EDGE : here ? 0 : SHADE;
    }
  }
  context.putImageData(image, 0, 0);
  return { shade: surface, share: count / inside.length };
}

/** Draw everything; `scale` is canvas px a px of the picture. */
export function drawScene(canvas, picture, scale, painted, state, radius) {
  const draw = canvas.getContext("2d");
  draw.setTransform(1, 0, 0, 1, 0, 0);
  draw.drawImage(picture, 0, 0, canvas.width, canvas.height);
  if (state.shade) draw.drawImage(state.shade, 0, 0);
  draw.setTransform(scale, 0, 0, scale, scale / 2, scale / 2); // pixel centres at integers
  for (const kind of ["wanted", "unwanted"]) for (const stroke of painted[kind]) drawStroke(draw, stroke, kind);
  if (state.stroke) drawStroke(draw, state.stroke, state.stroke.kind);
  const thin = Math.max(1.5, canvas.width / 400) / scale;
  draw.lineWidth = thin;
  draw.strokeStyle = COLOURS.line;
  draw.setLineDash([5 * thin, 3 * thin]);
  if (painted.rectangle && !state.corner) {
    const [x, y, width, height] = painted.rectangle;
    draw.strokeRect(x - 0.5, y - 0.5, width, height);
  }
  if (state.corner) {
    const [x, y] = state.corner;
    draw.strokeRect(x, y, state.hand[0] - x, state.hand[1] - y);
  }
  draw.setLineDash([]);
  if (state.cursor) drawCursor(draw, state.cursor, thin, state.tool === "rectangle" ? 0 : radius);
}

function drawStroke(draw, { radius, points }, kind) {
  draw.strokeStyle = COLOURS[kind];
  draw.lineWidth = 2 * radius;
  draw.lineCap = "round";
  draw.lineJoin = "round";
  draw.beginPath();
  draw.moveTo(...points[0]);
  for (const point of points) draw.lineTo(...point);
  if (points.length === 1) draw.lineTo(points[0][0] + 0.01, points[0][1]);
  draw.stroke();
  draw.lineCap = "butt";
  draw.lineJoin = "miter";
}

function drawCursor(draw, [x, y], thin, radius) {
  const arm = Math.max(radius, 8 * thin);
  for (const [colour, width] of [
    ["#000", 2.4 * thin],
    ["#fff", thin],
  ]) {
    draw.strokeStyle = colour;
    draw.lineWidth = width;
    draw.beginPath();
    draw.moveTo(x - arm, y);
    draw.lineTo(x + arm, y);
    draw.moveTo(x, y - arm);
    draw.lineTo(x, y + arm);
    if (radius) {
      draw.moveTo(x + radius, y);
      draw.arc(x, y, radius, 0, 2 * Math.PI);
    }
    draw.stroke();
  }
}
