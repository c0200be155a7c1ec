import math
import re
import shutil
import subprocess
from dataclasses import replace

import boards
import cv2
import numpy as np
import pytest
from conftest import missing
from pages import Page

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.calibration.figures.coverage import measure_coverage
from stereo_gpu.calibration.figures.lens import draw_distortion, radial_displacement, turning_radius
from stereo_gpu.calibration.figures.residuals import arrow_factor, pooled_residuals
from stereo_gpu.calibration.figures.space import Stage, look
from stereo_gpu.calibration.figures.svg import Frame, needles, ticks
from stereo_gpu.calibration.figures.tables import with_deviation
from stereo_gpu.calibration.figures.views import draw_views
from stereo_gpu.calibration.lens_models import LensModels
from stereo_gpu.calibration.outcome import Calibration, CalibrationView
from stereo_gpu.calibration.report import write_calibration_report
from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig, ViewError

BOARD = Board(columns=9, rows=7, square=30.0)
ROTATION = cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0]
SHIFT = np.array([-60.0, 1.5, 2.0])
EVIL = "<script>alert('1')</script>&amp;\"$title.png"


def make(count=8, *, out=(), names=None, noise=0.15, seed=5, **changes):
    """A calibration that knows the truth, whose corners were seen with noise; views in `out` do not count."""
    random = np.random.default_rng(seed)
    views, errors = [], []
    for number, (turn, shift) in enumerate(boards.poses(BOARD, count, seed=seed)):
        left, right = names[number] if names else (f"left{number:03d}.png", f"right{number:03d}.png")
        exact = (
            boards.project(BOARD, boards.LEFT, turn, shift),
            boards.project(BOARD, boards.RIGHT, *boards.moved(turn, shift, ROTATION, SHIFT)),
        )
        used = number not in out
        off = noise if used else 4.0
        seen = tuple(corners + random.normal(0, off, corners.shape) for corners in exact)
        views.append(
            CalibrationView(
                left=left,
                right=right,
                used=used,
                reason="" if used else f"does not fit, number {number}",
                seen=seen,
                projected=exact,
                rotation=cv2.Rodrigues(turn)[0],
                translation=shift,
            )
        )
        errors.append(ViewError(left, right, 0.21, 0.22, 0.1) if used else ViewError(left, right, used=False))
    lens = CameraDeviations(fx=0.34, fy=0.35, cx=0.5, cy=0.44, distortion=np.full(5, 0.003))
    settings = {
        "rig": Rig(
            left=Camera(*boards.LEFT, boards.SIZE, 0.2),
            right=Camera(*boards.RIGHT, boards.SIZE, 0.21),
            R=ROTATION,
            T=SHIFT,
            rms_px=0.205,
            epipolar_rms_px=0.1,
            views=tuple(errors),
        ),
        "board": BOARD,
        "views": tuple(views),
        "deviations": Deviations(left=lens, right=lens, om=np.full(3, 4e-4), T=np.array([0.05, 0.04, 0.2])),
    }
    return Calibration(**(settings | changes))


def write(tmp_path, calibration):
    text = write_calibration_report(calibration, tmp_path / "rig.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.balanced
    return page, text


def drawn_numbers(page):
    """Every number of every drawing."""
    for tag, attributes in page.tags:
        for name in ("d", "x", "y", "width", "height", "viewbox", "data-points", "data-view", "opacity"):
            value = attributes.get(name)
            if value is not None and tag in {"svg", "path", "rect", "text", "image"}:
                yield from (float(part) for part in re.split(r"[MLhz ,]+", value) if part)


def test_holds_every_view_and_what_the_calibration_says(tmp_path):
    models = LensModels(chosen=5, errors_px={5: 0.2101, 8: 0.2103, 12: 0.1944}, refused={12: "less certain"})
    calibration = make(
        out=(2,), advice=("no corner near the top", "next: hold it far away"), models=models, depth=(345.0, 0.352)
    )
    page, _ = write(tmp_path, calibration)
    for view in calibration.views:
        assert page.text.count(f"{view.left} · {view.right}") >= 2  # the table and the card
    for words in (
        "no corner near the top",
        "Hold it far away.",
        "7 of 8",
        "0.205 px",
        "420.00",
        "± 0.34",
        "-60.000",
        "1.146± 0.0232 %",  # R about x: 0.02 rad and 4e-4 rad, in degrees
        "± 0.050",
        "Left out: does not fit, number 2",
        "0.1944 px",
        "less certain",
        "± 0.35 mm",
        "at 345 mm",
    ):
        assert words in page.text
    assert page.text.index("no corner near the top") < page.text.index("Error of each view")


def test_every_number_that_is_drawn_is_finite(tmp_path):
    page, text = write(tmp_path, make(out=(1,)))
    numbers = list(drawn_numbers(page))
    assert len(numbers) > 5000
    assert all(math.isfinite(number) for number in numbers)
    assert not re.search(r"\b(nan|inf)\b", re.sub(r"<(script|style)>.*?</\1>", "", text, flags=re.DOTALL))


def test_loads_nothing_from_the_network(tmp_path):
    page, text = write(tmp_path, make())
    policy = next(tag["content"] for tag in page.all("meta") if "http-equiv" in tag)
    assert policy.startswith("default-src 'none'") and "http" not in policy
    assert "http" not in text.replace("http-equiv", "") and "url(" not in text and "@import" not in text
    for _, attributes in page.tags:
        assert "src" not in attributes
        assert attributes.get("href", "#").startswith(("data:image/png", "#"))


def test_nothing_from_outside_becomes_markup(tmp_path):
    calibration = make(names=[(EVIL, f"right {number}") for number in range(8)], out=(0,), advice=(EVIL,))
    page, text = write(tmp_path, calibration)
    assert "<script>alert" not in text
    assert len(page.all("script")) == 1
    assert page.text.count(EVIL) >= 8 * 2 + 1


def test_a_name_that_is_no_text_is_shown_as_what_it_is(tmp_path):
    page, _ = write(tmp_path, make(names=[("left\udcff.png", "right.png")] * 8))
    assert "left\\udcff.png" in page.text


def test_cameras_without_a_lens_error_are_drawn(tmp_path):
    rig = make().rig
    flat = Camera(rig.left.matrix, np.zeros(5), rig.left.size)
    page, _ = write(tmp_path, make(rig=replace(rig, left=flat, right=flat)))
    assert "Moved by up to 0 px" in page.text
    assert all(math.isfinite(number) for number in drawn_numbers(page))


def test_a_shown_arrow_is_the_residual(tmp_path):
    calibration = make(count=3, noise=0.0)
    off = np.zeros_like(calibration.views[1].seen[0])
    off[10] = 0.6, -0.3
    view = calibration.views[1]
    seen = (view.projected[0] + off, view.projected[1])
    shown = replace(view, seen=seen)
    calibration = make(count=3, noise=0.0, views=(calibration.views[0], shown, calibration.views[2]))
    drawn, told = draw_views(calibration)
    factor = float(re.search(r"drawn (\S+) times", told)[1])
    [needle] = [tag["d"] for tag in Page(drawn).all("path") if tag["class"].startswith("needle")]
    a, tip, b = (np.array(corner.split(" "), float) for corner in needle.strip("Mz").split("L"))
    frame = Frame(boards.SIZE, 280.0)
    np.testing.assert_allclose((a + b) / 2, frame.place(view.projected[0][10])[0], atol=0.11)
    np.testing.assert_allclose(tip - (a + b) / 2, factor * frame.scale * off[10], atol=0.15)


def test_needles_leave_out_what_is_no_number_or_no_length():
    starts = np.array([[1.0, 1], [5, 5], [9, 9]])
    ends = np.array([[4.0, 5], [np.nan, 5], [9, 9]])
    assert Page(needles(starts, ends, "needle")).all("path")[0]["d"].count("M") == 1
    assert needles(starts[1:], ends[1:], "needle") == ""


def test_pooled_residuals_hold_the_views_that_count():
    calibration = make(out=(0, 3), noise=0.2)
    residuals = pooled_residuals(calibration, 0)
    assert len(residuals.off) == 6 * 48
    assert residuals.rms == pytest.approx(0.2 * math.sqrt(2), rel=0.1)


def test_coverage_counts_the_views_of_each_cell(tmp_path):
    calibration = make()
    page, _ = write(tmp_path, calibration)
    width, height = boards.SIZE
    counts = np.zeros((2, 6, 8), int)
    for view in calibration.views:
        for side, corners in enumerate(view.seen):
            cells = {(int((y + 0.5) * 6 / height), int((x + 0.5) * 8 / width)) for x, y in corners}
            for row, column in cells:
                counts[side, row, column] += 1
    assert counts.max() > 3
    shown = re.findall(r'class="count">(\d+)<', (tmp_path / "rig.html").read_text(encoding="utf-8"))
    assert [int(count) for count in shown] == counts.reshape(-1).tolist()
    assert f"{100 * (counts[0] > 0).mean():.0f} % of the cells" in page.text


def test_the_radial_curve_is_what_the_lens_does():
    camera = Camera(boards.LEFT[0] * [[1, 1, 1], [1, 1 / 1.01, 1], [1, 1, 1]], [-0.21, 0.08, 0, 0, 0.02], boards.SIZE)
    radius, off = radial_displacement(camera)
    assert radius[-1] == pytest.approx(math.hypot(243, 360 - 1 - 176), abs=0.5)
    rays = np.column_stack([radius / 420.0, 0 * radius, 1 + 0 * radius])
    real = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
    np.testing.assert_allclose(off, real[:, 0] - 243.0 - radius, atol=1e-9)


def test_a_lens_that_folds_back_is_named():
    focal = 100.0
    matrix = np.array([[focal, 0, 160], [0, focal, 120], [0, 0, 1]])
    folding = Camera(matrix, [-0.5, 0, 0, 0, 0], (320, 240))
    # r (1 - 0.5 r^2) is largest where 1 = 1.5 r^2.
    assert turning_radius(folding) == pytest.approx(focal * math.sqrt(2 / 3), abs=2)
    assert turning_radius(Camera(matrix, [-0.05, 0, 0, 0, 0], (320, 240))) is None


def test_contours_lie_where_the_lens_moves_that_far():
    camera = Camera(boards.LEFT[0], boards.LEFT[1], boards.SIZE)
    drawing, _ = draw_distortion(camera, "left")
    contours = [tag["d"] for tag in Page(drawing).all("path") if tag["class"] == "contour"]
    assert len(contours) >= 3
    frame = Frame(boards.SIZE)
    lengths = []
    for contour in contours:
        places = np.array([part.split(" ") for part in re.split("[ML]", contour) if part], float)
        pixels = places / frame.scale - 0.5
        rays = np.column_stack([(pixels - camera.matrix[:2, 2]) / (420.0, 424.2), np.ones(len(pixels))])
        real = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
        moved = np.linalg.norm(real - pixels, axis=1)
        assert np.ptp(moved) < 0.15
        lengths.append(moved.mean())
    steps = np.diff([0.0, *sorted(lengths)])
    np.testing.assert_allclose(steps, steps[0], rtol=0.1)


def test_space_is_seen_from_the_side_that_is_told():
    stage = Stage(np.zeros(3), 1.0, 100.0, np.zeros(2))
    forward, right, down = np.eye(3)[[2, 0, 1]]
    above = look(np.array([forward, right, down]), stage, yaw=0.0, pitch=np.pi / 2)
    assert above[0, 1] < -20 and above[1, 0] > 20 and above[2, 2] > 0.9  # forward is up, and what is low is far
    behind = look(np.array([forward, right, down]), stage, yaw=0.0, pitch=0.0)
    assert behind[0, 2] > 0.9 and behind[1, 0] > 20 and behind[2, 1] > 20


@pytest.mark.parametrize(
    ("value", "deviation", "words"),
    [
        (657.3954, 0.3466, "657.40 ± 0.35"),
        (-0.2529, 0.0021, "-0.2529 ± 0.0021"),
        (1234.5, 37.0, "1234 ± 37"),
        (99.9, 0.0, "99.9"),
        (1.0, math.nan, "unknown"),
        (-100.0, 0.0999, "-100.00 ± 0.10"),
    ],
)
def test_values_have_the_digits_that_their_deviation_allows(value, deviation, words):
    assert with_deviation(value, deviation) == words


def test_scales_are_round_and_arrows_short_enough():
    assert ticks(-0.6, 0.6) == [-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6]
    for longest in (0.0137, 0.2, 3.0, 77.0):
        factor = arrow_factor(longest, 20.0)
        assert 20.0 / 2.6 <= factor * longest <= 20.02
    assert arrow_factor(0.0, 20.0) == 1.0


def test_thirty_views_stay_small_and_a_thousand_are_thinned_out(tmp_path):
    _, text = write(tmp_path, make(30))
    assert len(text) < 2_000_000
    many = make(1000, out=range(0, 1000, 10))
    page, text = write(tmp_path, many)
    cards = {f"#{tag['id']}" for tag in page.all("figure") if "id" in tag}
    assert len(cards) == 60 and cards == {tag["href"] for tag in page.all("a")}
    assert len(text) < 4_000_000
    assert "Drawn are 60 of 1000 views" in page.text
    assert "820 more boards are not drawn" in page.text
    assert "2,500 of them drawn" in page.text and "4,000 of 43,200 corners drawn" in page.text
    for view in many.views:
        assert view.left in page.text
    assert page.text.count("left out: does not fit") == 100


def test_views_that_show_nothing_are_told(tmp_path):
    calibration = make(4, out=(3,))
    blank = CalibrationView(
        left="a.png",
        right="b.png",
        used=False,
        reason="no board in the left picture",
        seen=(None, calibration.views[3].seen[1]),
        projected=(None, None),
        rotation=None,
        translation=None,
    )
    page, _ = write(tmp_path, make(4, out=(3,), views=(*calibration.views[:3], blank)))
    assert "no board found" in page.text and "Left out: no board in the left picture" in page.text
    page, _ = write(tmp_path, make(1, out=(0,), views=(blank,)))  # nothing at all counts
    assert "0 residuals are too few to draw" in page.text and "0 of 1" in page.text


def test_parts_of_a_board_are_known_by_their_ids(tmp_path):
    views = []
    for view in make().views:
        ids = np.arange(4, 40, dtype=np.int32)
        part = [tuple(corners[ids] for corners in both) for both in (view.seen, view.projected)]
        views.append(replace(view, seen=part[0], projected=part[1], ids=(ids, ids)))
    page, _ = write(tmp_path, make(views=tuple(views), board=CharucoBoard(9, 7, 30.0, 22.0)))
    assert "288 corners" in page.text
    assert "markers of 5x5_250" in page.text
    # A board leans as it does when all of it is seen; with the first 36 points in place of these it would not.
    whole, part = (measure_coverage(one)[0].placements for one in (make(), make(views=tuple(views))))
    for one, other in zip(whole, part, strict=True):
        assert (other.lean_x, other.lean_y) == pytest.approx((one.lean_x, one.lean_y), abs=0.1)


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match="there is no folder"):
        write_calibration_report(make(3), tmp_path / "none" / "rig.html")
    assert not list(tmp_path.iterdir())


def test_real_boards(board_calibration, tmp_path):
    page, text = write(tmp_path, board_calibration)
    assert len(text) < 600_000
    assert all(math.isfinite(number) for number in drawn_numbers(page))
    for view in board_calibration.views:
        assert page.text.count(view.left) >= 2 and page.text.count(view.right) >= 2
    assert "13 of 13" in page.text and "702 corners" in page.text


CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def test_the_browser_draws_what_python_drew(tmp_path):
    if CHROMIUM is None:
        missing("chromium", "no browser; install chromium")
    page, text = write(tmp_path, make(5))
    click = "<script>document.querySelector('[data-view=first]').click();document.title='turned'</script></body>"
    (tmp_path / "rig.html").write_text(text.replace("</body>", click), encoding="utf-8")
    switches = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    shown = subprocess.run(
        [CHROMIUM, *switches, "--virtual-time-budget=2000", "--dump-dom", (tmp_path / "rig.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    again = Page(shown)
    assert "turned" in again.text

    def space(parsed):
        return {tag["data-points"]: tag for name, tag in parsed.tags if "data-points" in tag}

    assert len(space(page)) > 15 and space(page).keys() == space(again).keys()
    for points, tag in space(page).items():
        for name in ("d", "x", "y"):
            if name in tag:
                numbers = [[float(n) for n in re.split("[MLz ]+", t[name]) if n] for t in (tag, space(again)[points])]
                # The points in the page have four digits.
                np.testing.assert_allclose(*numbers, atol=0.6)
