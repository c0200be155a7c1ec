"""The two cameras and the boards in space, drawn from one side; turn.js draws the same from any other."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from stereo_gpu.calibration.figures.svg import round_number, thinned
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.rig import Camera
from stereo_gpu.types import Doubles

MOST_BOARDS = 80
SIZE = (720.0, 540.0)  # units
YAW, PITCH = -0.85, 0.34  # rad: from the right, behind and above
EYE = 4.0  # distance of the eye in radii of the scene: near enough to tell front from back
FILL = 0.93  # of the drawing's width or height: what the scene takes


@dataclass(frozen=True)
class Thing:
    """One part of the scene.

    Args:
        kind: "line", "area" or "words".
        css: class of the style sheet.
        points: (N, 3), in the rig's unit, frame of the left camera; one point for words.
        text: what the words say, or what is told when the pointer rests on the thing.
        layer: things are drawn layer by layer, and within one from the farthest to the nearest.
    """

    kind: str
    css: str
    points: Doubles
    text: str = ""
    layer: int = 1


@dataclass(frozen=True)
class Stage:
    """How the scene is laid into the drawing.

    Args:
        middle: (3,), the point that it turns about.
        radius: of the ball about it that holds everything.
        scale: units that the radius takes at a distance of 1 radius from the eye.
        place: (2,), where in the drawing the middle is.
    """

    middle: Doubles
    radius: float
    scale: float
    place: Doubles


def draw_space(calibration: Calibration) -> tuple[str, str]:
    """The scene as SVG whose parts carry their points, for turn.js; returns it and its caption."""
    rig = calibration.rig
    boards, left_away = _boards(calibration)
    depth = float(np.median([np.linalg.norm(board.points.mean(axis=0)) for board in boards])) if boards else 0.0
    things = [*boards, *_cameras(calibration, depth)]
    every = np.concatenate([thing.points for thing in things])
    step = round_number(float(np.ptp(every, axis=0).max()) / 6)
    things = [_floor(every, step), *things]
    every = np.concatenate([things[0].points, every])
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    radius = float(np.linalg.norm(every - middle, axis=1).max())
    stage = _fit(every, middle, radius)
    drawn = "".join(_draw(thing, stage) for thing in _sorted(things, stage))
    numbers = " ".join(f"{value:.6g}" for value in (*middle, radius, YAW, PITCH, EYE, FILL))
    told = (
        f"Drag to turn, or use the buttons. The floor's squares are {step:g} {rig.unit}; boards carry their view's"
        " number beside their first corner."
    )
    if left_away:
        told += f" {left_away} more boards are not drawn."
    svg = (
        f'<svg viewBox="0 0 {SIZE[0]:g} {SIZE[1]:g}" class="space" role="img" tabindex="0" data-view="{numbers}"'
        f' aria-label="Cameras and boards in space; arrow keys turn them">{drawn}</svg>'
    )
    return svg, told


def look(points: Doubles, stage: Stage, yaw: float = YAW, pitch: float = PITCH) -> Doubles:
    """Points (N, 3) as places in the drawing and their depth, (N, 3); what turn.js does in the browser."""
    x, y, z = ((points - stage.middle) / stage.radius).T
    x, z = x * np.cos(yaw) + z * np.sin(yaw), z * np.cos(yaw) - x * np.sin(yaw)
    y, z = y * np.cos(pitch) - z * np.sin(pitch), z * np.cos(pitch) + y * np.sin(pitch)
    scale = stage.scale / (EYE + z)
    return np.column_stack([stage.place[0] + scale * x, stage.place[1] + scale * y, z])


def _fit(points: Doubles, middle: Doubles, radius: float) -> Stage:
    """The stage on which the points fill the drawing, seen from where it is looked at first."""
    seen = look(points, Stage(middle, radius, 1.0, np.zeros(2)))[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float((FILL * np.array(SIZE) / (high - low)).min())
    return Stage(middle, radius, scale, np.array(SIZE) / 2 - scale * (low + high) / 2)


def _sorted(things: list[Thing], stage: Stage) -> list[Thing]:
    """From the farthest to the nearest within each layer."""

    def order(thing: Thing) -> tuple[int, float]:
        return thing.layer, -float(look(thing.points, stage)[:, 2].mean())

    return sorted(things, key=order)


def _draw(thing: Thing, stage: Stage) -> str:
    held = " ".join(",".join(f"{value:.4g}" for value in point) for point in thing.points)
    places = look(thing.points, stage)
    data = f'class="{thing.css}" data-kind="{thing.kind}" data-layer="{thing.layer}" data-points="{held}"'
    if thing.kind == "words":
        x, y, _ = places[0]
        return f'<text {data} x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{escape(thing.text)}</text>'
    told = f"<title>{escape(thing.text)}</title>" if thing.text else ""
    if thing.kind == "line":  # separate pieces, two points each
        steps = "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for a, b, c, d in places[:, :2].reshape(-1, 4))
    else:
        steps = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y, _ in places) + "z"
    return f'<path {data} d="{steps}">{told}</path>'


def _boards(calibration: Calibration) -> tuple[list[Thing], int]:
    points = np.asarray(calibration.board.points, np.float64)
    margin = np.array([calibration.board.square, calibration.board.square, 0.0])
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    outline = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    known = [
        number
        for number, view in enumerate(calibration.views)
        if view.used
        and view.rotation is not None
        and view.translation is not None
        and np.isfinite(view.rotation).all()
        and np.isfinite(view.translation).all()
    ]
    things = []
    for index in thinned(len(known), MOST_BOARDS):
        number = known[index]
        view = calibration.views[number]
        assert view.rotation is not None and view.translation is not None  # `known` holds no others
        shift = np.asarray(view.translation, np.float64).reshape(3)

        def carried(on_board: Doubles, rotation: Doubles = view.rotation, shift: Doubles = shift) -> Doubles:
            return np.asarray(on_board @ rotation.T + shift)

        names = f"{number + 1}. {view.left} · {view.right}"
        things += [
            Thing("area", "plate", carried(outline), names),
            Thing("words", "plate-number", carried(np.zeros((1, 3))), str(number + 1), layer=2),
        ]
    return things, len(known) - min(len(known), MOST_BOARDS)


def _cameras(calibration: Calibration, depth: float) -> list[Thing]:
    rig = calibration.rig
    centre = -rig.R.T @ rig.T
    # Long enough to be seen from the farthest board, short enough that the two do not run into each other.
    length = float(np.clip(0.5 * rig.baseline, 0.06 * depth, 0.2 * depth))
    middle = centre / 2
    things = []
    for name, camera, rotation, place in (
        ("left", rig.left, np.eye(3), np.zeros(3)),
        ("right", rig.right, rig.R, centre),
    ):
        eye, window = _pyramid(camera, length)
        eye, window = (points @ rotation + place for points in (eye, window))  # rows times R are R' times columns
        spokes = np.stack([np.broadcast_to(eye, window.shape), window], axis=1).reshape(-1, 3)
        things += [
            Thing("line", f"spokes {name}", spokes),
            Thing("area", f"window {name}", window, f"{name} camera"),
            Thing(
                "words", f"name {name}", place + np.array([[0, -0.6 * length, 1.1 * length]]) @ rotation, name, layer=2
            ),
        ]
    things.append(Thing("line", "baseline", np.array([np.zeros(3), centre])))
    below = np.array([[0.0, 0.35 * length, -0.5 * length]])
    things.append(Thing("words", "name", middle + below, f"{rig.baseline:.4g} {rig.unit}", layer=2))
    return things


def _pyramid(camera: Camera, length: float) -> tuple[Doubles, Doubles]:
    """What a camera sees out to a distance: its centre (1, 3) and the four corners of its picture (4, 3)."""
    width, height = camera.size
    corners = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    rays = (corners - camera.matrix[:2, 2]) / (camera.matrix[0, 0], camera.matrix[1, 1])
    return np.zeros((1, 3)), np.column_stack([rays, np.ones(4)]) * length


def _floor(every: Doubles, step: float) -> Thing:
    """A grid below everything, y pointing down, on round multiples of its step."""
    low, high = np.floor(every.min(axis=0) / step) * step, np.ceil(every.max(axis=0) / step) * step
    bottom = every[:, 1].max() + 0.02 * np.ptp(every[:, 1])
    across, along = (np.arange(low[axis], high[axis] + step / 2, step) for axis in (0, 2))
    pieces = [[[x, bottom, low[2]], [x, bottom, high[2]]] for x in across]
    pieces += [[[low[0], bottom, z], [high[0], bottom, z]] for z in along]
    return Thing("line", "floor", np.array(pieces, np.float64).reshape(-1, 3), layer=0)
