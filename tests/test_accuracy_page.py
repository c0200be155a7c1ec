"""What tools/accuracy writes, from small pairs whose truth is known; no real pictures are needed."""

import cv2
import numpy as np
import pytest
from conftest import need_matplotlib

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.accuracy import BoardResult, found_range, measure_pair
from stereo_gpu.evaluation.accuracy_tables import (
    board_tables,
    confidence_table,
    cost_table,
    light_table,
    pair_table,
    range_table,
)
from stereo_gpu.evaluation.cost import Cost, measure_costs
from stereo_gpu.evaluation.matchers import AUTO, FAST, PRECISE, YARDSTICK, Found, Matcher, opencv_matchers, our_matchers
from stereo_gpu.evaluation.pairs import PAIRS, TruePair, load_pair
from stereo_gpu.evaluation.scores import score
from stereo_gpu.evaluation.sections import put_section
from stereo_gpu.evaluation.trade_plot import draw_trade

WIDTH, HEIGHT, SHIFT = 160, 96, 10.25


@pytest.fixture(scope="module")
def pair():
    """Random texture on a plane that faces the cameras; the left columns have no partner."""
    noise = np.random.default_rng(5).integers(0, 256, (HEIGHT, WIDTH + 40)).astype(np.float32)
    right = cv2.GaussianBlur(noise, (0, 0), 1.5)
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32) + 20, np.arange(HEIGHT, dtype=np.float32))
    left = cv2.remap(right, x - SHIFT, y, cv2.INTER_LINEAR)
    nonocc = np.zeros((HEIGHT, WIDTH), bool)
    nonocc[:, 20:-20] = True
    return TruePair(
        name="slab",
        left=np.clip(left, 0, 255).astype(np.uint8),
        right=np.clip(right[:, 20 : 20 + WIDTH], 0, 255).astype(np.uint8),
        truth=np.full((HEIGHT, WIDTH), SHIFT, np.float32),
        masks={"all": np.ones((HEIGHT, WIDTH), bool), "nonocc": nonocc},
        search=(0, 32),
        published={"others": np.full((HEIGHT, WIDTH), SHIFT + 0.75, np.float32)},
        depth=lambda disparity: 1000.0 / disparity.astype(np.float64),
    )


def constant(name, value, confidence=None, search=(0, 32)):
    """A matcher that gives the same whatever it sees, but nothing in the first ten columns."""

    def find(left, right, _, masks=(None, None)):
        values = np.array(np.broadcast_to(value, left.shape[:2]), np.float32)
        values[:, :10] = np.nan
        return Found(values=values, search=search, confidence=confidence)

    return Matcher(name, find, lambda *given: lambda: find(*given), ours=confidence is not None)


def cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.parametrize("matcher", opencv_matchers(), ids=lambda matcher: matcher.name)
@pytest.mark.parametrize(("smallest", "move"), [(0, 0), (-24, 20)], ids=["positive", "negative"])
def test_opencv_finds_the_slab_up_to_the_edges_of_what_both_see(pair, matcher, smallest, move):
    """Moving one picture makes its disparities negative; widened pictures lose no columns."""
    right = np.roll(pair.right, move, axis=1)
    found = matcher.find(pair.left, right, (smallest, 40))
    assert found.search == (smallest, 48)  # a multiple of 16
    assert found.values.shape == pair.truth.shape
    scores = score(found.values, pair.truth - move, pair.masks["nonocc"])
    assert scores.coverage > 0.85
    assert scores.quantiles[50] < 0.2


def test_profiles_give_values_confidence_and_range(pair):
    found = {matcher.name: matcher.find(pair.left, pair.right, pair.search) for matcher in our_matchers(None)}
    assert {PRECISE, FAST, AUTO} < set(found)
    for name, each in found.items():
        assert each.confidence.shape == each.values.shape
        assert (each.search == pair.search) == (name != AUTO)


def test_pair_table_counts_as_it_says(pair):
    measured = measure_pair(pair, [constant("off", SHIFT - 1.5)])
    title, _, head, _, others, off = pair_table(measured)
    assert title == "Slab: 160 x 96, 32 disparities, 11520 non-occluded pixels, 0.1 to 0.1 m away."
    row = dict(zip(cells(head), cells(off), strict=True))
    assert (row["bad-0.5"], row["bad-1.0"], row["bad-2.0"]) == ("100.00 %", "100.00 %", "0.00 %")
    assert (row["coverage"], row["all"]) == ("100.00 %", "100.00 %")
    assert (row["mean px"], row["mean mm"]) == ("1.50", f"{1000 / (SHIFT - 1.5) - 1000 / SHIFT:.1f}")
    published = dict(zip(cells(head), cells(others), strict=True))
    assert (published["bad-0.5"], published["bad-1.0"]) == ("100.00 %", "0.00 %")


def test_light_table_tells_points(pair):
    good, bad = (measure_pair(pair, [constant("one", value)]) for value in (SHIFT, SHIFT + 2))
    row = next(line for line in light_table(good, [bad, good]) if line.startswith("| one"))
    assert cells(row) == ["one", "0.00 %", "100.00 %", "+100.00", "0.00 %", "+0.00"]


def test_board_tables_average_over_the_pictures(pair):
    boards = [
        BoardResult(
            name=f"left{number}",
            flatness_px=0.1,
            scores=dict.fromkeys((AUTO, FAST, YARDSTICK), score(pair.truth + off, pair.truth)),
            range=found_range("board", pair.truth, (0, 32)),
        )
        for number, off in enumerate((0.5, 2.0))
    ]
    lines = list(board_tables(boards))
    assert cells(lines[2]) == [AUTO, "100.00 %", "1.25", "50.00 %", "50.00 %"]
    assert cells(lines[-1])[-1] == "100%, 2.00, 100%"


@pytest.mark.parametrize(
    ("search", "inside"), [((0, 11), 1.0), ((0, 10), 0.0), ((10, 1), 1.0), ((11, 9), 0.0), ((-3, 40), 1.0)]
)
def test_range_holds_what_it_can_give(pair, search, inside):
    assert found_range("slab", pair.truth, search).inside == inside


def test_range_is_held_against_the_true_one():
    found = found_range("ramp", np.linspace(10, 30, 100, dtype=np.float32).reshape(10, 10), (5, 30))
    assert (found.span, found.ratio, found.inside) == ((10.0, 30.0), 1.5, 1.0)
    assert cells(list(range_table([found], []))[-1]) == ["average", "", "", "1.50", "100.00 % at least"]


def test_confidence_table_tells_chance_from_knowledge(pair):
    values = np.where(np.arange(WIDTH) < WIDTH / 2, SHIFT, SHIFT + 2)
    knows, tells_nothing = ((values == SHIFT).astype(np.float32) + np.zeros_like(pair.truth), np.ones_like(pair.truth))
    matchers = [constant("knows", values, knows), constant("nothing", values, tells_nothing), constant("mute", values)]
    rows = [cells(row) for row in confidence_table([measure_pair(pair, matchers)])[2:]]
    assert [row[1] for row in rows] == ["knows", "nothing"]
    assert [row[-1] for row in rows] == ["0.00", "1.00"]
    assert rows[0][2] == rows[0][3] == rows[1][3]  # the best that is possible
    assert rows[1][2] == rows[1][4] == "50.00 %"


def test_cost_is_told_beside_what_is_wrong(pair):
    matchers = [constant(YARDSTICK, SHIFT), constant("other", SHIFT + 2)]
    measured = {"slab": measure_pair(pair, matchers)}
    plain = Cost(wall_s=0.01, cpu_s=0.01, wall=1.0, cpu=1.0)
    twice = Cost(wall_s=0.02, cpu_s=0.04, wall=2.0, cpu=4.0)
    costs = {name: {YARDSTICK: plain, "other": twice} for name in ("bench", "slab")}
    first, second = list(cost_table(costs, measured))[2:]
    assert cells(first) == [YARDSTICK, "10", "1.00", "1.00", "1.00", "0.00 %"]
    assert cells(second) == ["other", "20", "2.00", "4.00", "2.00", "100.00 %"]
    need_matplotlib()
    assert draw_trade(costs, measured, matchers).startswith(b"\x89PNG")


def test_costs_are_ratios_to_the_yardstick(pair):
    names = ("StereoBM 15x15", YARDSTICK)
    matchers = [matcher for matcher in opencv_matchers() if matcher.name in names]
    costs = measure_costs(pair.left, pair.right, pair.search, matchers, seconds=0.05, cap=1.0)
    assert (costs[YARDSTICK].wall, costs[YARDSTICK].cpu) == (1.0, 1.0)
    block = costs["StereoBM 15x15"]
    assert block.wall == pytest.approx(block.wall_s / costs[YARDSTICK].wall_s)
    assert 0 < block.wall_s < 1


def test_sections_replace_only_what_is_between_their_marks():
    page = "a\n<!-- one: generated -->\nold\n<!-- one: end -->\nb\n<!-- two: generated -->\n<!-- two: end -->\nc\n"
    once = put_section(page, "one", ["new", "lines"])
    assert once == page.replace("old", "\nnew\nlines\n")
    assert put_section(once, "one", ["new", "lines"]) == once


@pytest.mark.parametrize(
    "page",
    [
        "nothing",
        "<!-- one: generated -->\n",
        "<!-- one: end -->\n<!-- one: generated -->\n",
        2 * "<!-- one: generated -->\n<!-- one: end -->\n",
    ],
)
def test_pages_without_marks_are_refused(page):
    with pytest.raises(InputError, match="once each and in this order"):
        put_section(page, "one", ["new"])


def test_wrong_pairs_and_folders_are_named(tmp_path):
    with pytest.raises(InputError, match="pair 'cones': it must be one of tsukuba"):
        load_pair(tmp_path, "cones")
    with pytest.raises(InputError, match="set STEREO_GPU_DATA"):
        load_pair(tmp_path, "teddy")


@pytest.mark.parametrize("name", PAIRS)
def test_real_pairs_have_pictures_and_truth_of_one_size(data, name):
    pair = load_pair(data, name)
    shapes = {pair.left.shape, pair.right.shape}
    assert len(shapes) == 1
    assert {pair.truth.shape, *(mask.shape for mask in pair.masks.values())} == {pair.left.shape[:2]}
    low, high = pair.span
    assert pair.search[0] <= low < high <= sum(pair.search) - 1
    assert ("nonocc" in pair.masks) == (name in ("tsukuba", "teddy"))
    assert (pair.depth is not None) == (name == "motorcycle")
