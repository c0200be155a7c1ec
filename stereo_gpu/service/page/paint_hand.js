// What moves the brush: a mouse, a pen or a finger, or keys. Places are px of the picture, pixel centres at integers.

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Begin, move and end by pointer. */
export function pointer(canvas, size, hand) {
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [
      Math.min(size[0], Math.max(0, ((event.clientX - box.left) / box.width) * size[0])) - 0.5,
      Math.min(size[1], Math.max(0, ((event.clientY - box.top) / box.height) * size[1])) - 0.5,
    ];
  };
  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    if (held !== null || event.button !== 0) return;
    held = event.pointerId;
    canvas.setPointerCapture(held);
    hand.show(null);
    hand.begin(place(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.pointerId === held) for (const each of event.getCoalescedEvents?.() ?? [event]) hand.move(place(each));
    else if (held === null && event.pointerType !== "touch") hand.show(place(event));
  });
  canvas.addEventListener("pointerup", (event) => {
    if (event.pointerId !== held) return;
    held = null;
    hand.end(place(event));
  });
  canvas.addEventListener("pointercancel", (event) => {
    if (event.pointerId !== held) return;
    held = null;
    hand.abandon();
  });
  canvas.addEventListener("pointerleave", () => held === null && hand.show(null));
}

/** The same by arrows, Enter or Space, and Escape. */
export function keyboard(canvas, size, hand) {
  let at = [size[0] / 2, size[1] / 2];
  canvas.addEventListener("focus", () => canvas.matches(":focus-visible") && hand.show(at));
  canvas.addEventListener("blur", () => hand.show(null));
  canvas.addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() === "z" && (event.ctrlKey || event.metaKey)) hand.undo();
    else if (event.key in ARROWS) {
      const step = Math.max(1, Math.round(Math.max(...size) / 100)) * (event.shiftKey ? 5 : 1);
      at = at.map((value, axis) => Math.min(size[axis] - 0.5, Math.max(-0.5, value + step * ARROWS[event.key][axis])));
      hand.show(at);
      if (hand.holds()) hand.move(at);
    } else if (event.key === "Enter" || event.key === " ") {
      if (event.repeat) return event.preventDefault();
      hand.show(at);
      if (hand.holds()) hand.end(at);
      else {
        hand.begin(at);
        hand.tell(`Begun at ${Math.round(at[0])}, ${Math.round(at[1])}: move on, and press Enter again.`);
      }
    } else if (event.key === "Escape" && hand.holds()) hand.abandon();
    else return;
    event.preventDefault();
  });
}
