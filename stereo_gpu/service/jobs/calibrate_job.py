"""Board pictures of both cameras to a rig, with all that tells whether it is a good one, in the service's folders."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stereo_gpu.boards.choose import choose_board
from stereo_gpu.calibrate import calibrate_in_full
from stereo_gpu.calibration.figures.alone import stand_alone
from stereo_gpu.calibration.figures.coverage import draw_coverage, measure_coverage
from stereo_gpu.calibration.figures.residuals import draw_field, pooled_residuals
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.calibration.report import SIDES, write_calibration_report
from stereo_gpu.engines.executor import Tell
from stereo_gpu.files import write_whole
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.jobs.order import WorkOrder
from stereo_gpu.service.jobs.outcome import Outcome
from stereo_gpu.service.jobs.rig_summary import summarise


def calibrate_job(order: WorkOrder, folders: Folders, tell: Tell) -> Outcome:
    """Calibrate into the attempt's folder; errors are those of `calibrate_in_full`.

    rig.json, report.html, calibration.json (errors of each view, coverage, advice), and for the page
    coverage-left.svg, arrows-left.svg and those of the right camera.
    """
    options = order.options
    board = choose_board(options["board"], options["square"], options.get("marker"), options.get("dictionary"))
    inputs = folders.inputs(order.job)
    left, right = (sorted(inputs / name for name in order.inputs if name.startswith(side)) for side in SIDES)
    watch = _Watch(tell)
    watch.begin("find")
    calibration = calibrate_in_full(left, right, board, progress=watch.searched)
    folder = folders.attempt(order.job, order.number)
    folder.mkdir(mode=0o700)
    watch.begin("report")
    calibration.rig.save(folder / "rig.json")
    write_calibration_report(calibration, folder / "report.html")
    for kind, side, drawing in _drawings(calibration):
        write_whole(folder / f"{kind}-{side}.svg", stand_alone(drawing))
    told = _told(calibration)
    watch.end()
    outcome = Outcome(
        summary={name: told[name] for name in ("pairs", "used", "coverage", "rig")},
        warnings=calibration.advice,
        seconds=watch.seconds,
        rig=told["rig"],
    )
    content = {**told, **outcome.as_json()}
    write_whole(folder / "calibration.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    return outcome


def _drawings(calibration: Calibration) -> Iterator[tuple[str, str, str]]:
    """Kind, camera and drawing of each picture; those without corners enough are left out."""
    coverages = measure_coverage(calibration)
    for side, name in enumerate(SIDES):
        yield "coverage", name, draw_coverage(calibration, side, coverages)[0]
        arrows, _ = _arrows(calibration, side)
        if arrows:
            yield "arrows", name, arrows


def _arrows(calibration: Calibration, side: int) -> tuple[str, str]:
    camera = (calibration.rig.left, calibration.rig.right)[side]
    return draw_field(pooled_residuals(calibration, side), camera.size, SIDES[side])


def _told(calibration: Calibration) -> dict[str, Any]:
    rig = calibration.rig
    coverages = measure_coverage(calibration)
    return {
        "rig": summarise(rig),
        "pairs": len(rig.views),
        "used": sum(view.used for view in rig.views),
        "coverage": {name: round(coverage.share, 4) for name, coverage in zip(SIDES, coverages, strict=True)},
        "arrows": {name: _arrows(calibration, side)[1] for side, name in enumerate(SIDES)},
        "advice": list(calibration.advice),
        "depth": None if calibration.depth is None else dict(zip(("at", "deviation"), calibration.depth, strict=True)),
        "views": [
            {
                "left": Path(view.left).name,
                "right": Path(view.right).name,
                "used": view.used,
                "reason": view.reason,
                "left_px": view.left_px,
                "right_px": view.right_px,
                "epipolar_px": view.epipolar_px,
            }
            for view in rig.views
        ],
    }


class _Watch:
    """Tells the stages, and how many pictures have been searched, and keeps the seconds."""

    def __init__(self, tell: Tell) -> None:
        self.seconds: dict[str, float] = {}
        self._tell = tell
        self._stage, self._began = "", 0.0

    def begin(self, stage: str) -> None:
        self.end()
        self._stage, self._began = stage, time.perf_counter()
        self._tell(stage)

    def end(self) -> None:
        if self._stage:
            self.seconds[self._stage] = time.perf_counter() - self._began

    def searched(self, done: int, total: int) -> None:
        if done == total:
            self.begin("fit")
        else:
            self._tell(f"find:{done / total:.3f}")
