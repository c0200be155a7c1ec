"""The matching kernels against the loops in reference.py, on every device: odd sizes, junk in the outputs."""

import numpy as np
import pytest
import reference

WIDTH, HEIGHT = 53, 37
# Wider than the blocks of the forms for CPUs, and narrower than a vector.
SHAPES = [(HEIGHT, WIDTH), (9, 311), (1, 1), (40, 1)]
# Correlations of whole grey levels differ from double precision by the rounding of one product of sums.
SCORE_TOLERANCE = 1e-4
# A parabola divides by the bend at the peak, which magnifies the scores' rounding.
DISPARITY_TOLERANCE = 1e-3


def scene(seed=0):
    """Two centred pictures in whole grey levels: a shifted random texture with a flat patch and noise."""
    rng = np.random.default_rng(seed)
    wide = rng.integers(-120, 121, (HEIGHT, WIDTH + 12)).astype(np.float32)
    wide = np.round((wide + np.roll(wide, 1, 1) + np.roll(wide, 1, 0)) / 3)
    left, right = wide[:, 6 : 6 + WIDTH].copy(), wide[:, 9 : 9 + WIDTH].copy()
    right += rng.integers(-3, 4, right.shape)
    left[20:30, 10:24] = 7
    right[20:30, 10:24] = 7
    return left, right


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def norms(backend, picture, mask, radius, threshold):
    out = [junk(backend, picture.shape, t) for t in (np.float32, np.float32, np.uint8)]
    backend.launch(
        "window_norms",
        picture=backend.upload(picture),
        mask=backend.upload(mask),
        width=picture.shape[1],
        height=picture.shape[0],
        radius=radius,
        threshold=threshold,
        sum_out=out[0],
        inverse_out=out[1],
        validity_out=out[2],
    )
    return out


def prepared(backend, ref, oth, mask, radius, threshold=5.0):
    ref_sum, ref_inverse, validity = norms(backend, ref, mask, radius, threshold)
    oth_sum, oth_inverse, _ = norms(backend, oth, np.ones_like(mask), radius, threshold)
    arrays = {
        "reference": backend.upload(ref),
        "other": backend.upload(oth),
        "reference_sum": ref_sum,
        "reference_inverse": ref_inverse,
        "other_sum": oth_sum,
        "other_inverse": oth_inverse,
    }
    return arrays, validity


def winners(backend, shape):
    return {
        "disparity_out": junk(backend, shape, np.float32),
        "score_out": junk(backend, shape, np.float32),
        "ratio_out": junk(backend, shape, np.float32),
        "validity_out": junk(backend, shape, np.uint8),
        "other_out": backend.zeros(shape, np.int32),
    }


def key_index(key, bits=7):
    return np.where(key > 0, 2**bits - 1 - key % 2**bits, -1)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("dtype", "brightest", "channels", "black", "scale"),
    [
        (np.uint8, 255, 3, 0.0, 1.0),
        (np.uint8, 255, 1, 0.0, 1.0),
        (np.uint16, 4095, 3, 300.0, 255 / 3700),
        (np.uint16, 4095, 1, 40.0, 0.07),
    ],
)
def test_grey(backend, shape, dtype, brightest, channels, black, scale):
    whole = shape if channels == 1 else (*shape, channels)
    picture = np.random.default_rng(1).integers(0, brightest, whole, dtype, endpoint=True)
    out = junk(backend, shape, np.float32)
    backend.launch(
        "grey",
        picture=backend.upload(picture),
        width=shape[1],
        height=shape[0],
        channels=channels,
        black=black,
        scale=scale,
        grey_out=out,
    )
    difference = np.abs(backend.download(out) - reference.grey(picture, black, scale))
    # Single and double precision may round a luma of exactly one half apart.
    assert (difference > 0).mean() < 0.002
    assert difference.max() <= 1


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [1, 2, 40])
def test_smooth(backend, shape, radius):
    picture = np.random.default_rng(2).integers(-128, 128, shape).astype(np.float32)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / (0.5 * radius)) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    arrays = [backend.upload(picture), junk(backend, shape, np.float32), junk(backend, shape, np.float32)]
    for axis in (0, 1):
        backend.launch(
            "smooth",
            source=arrays[axis],
            weights=backend.upload(weights),
            width=shape[1],
            height=shape[0],
            radius=radius,
            axis=axis,
            smoothed_out=arrays[axis + 1],
        )
    difference = np.abs(backend.download(arrays[2]) - reference.smooth(picture, weights.astype(float)))
    assert (difference > 0).mean() < 0.002
    assert difference.max() <= 1


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [3, 11, 31])
def test_window_norms(backend, shape, size):
    picture = np.random.default_rng(3).integers(-128, 128, shape).astype(np.float32)
    picture[3:, 2:40] = 7
    mask = np.ones(shape, np.uint8)
    mask[:5, 5:9] = 0
    out = [backend.download(a) for a in norms(backend, picture, mask, size // 2, 5.0)]
    sums, inverses, validity = reference.window_norms(picture, mask, size // 2, 5.0)
    np.testing.assert_array_equal(out[0], sums)
    np.testing.assert_allclose(out[1], inverses, rtol=1e-5)
    np.testing.assert_array_equal(out[2], validity)


@pytest.mark.parametrize(
    ("size", "smallest", "disparities", "direction"),
    [(3, 0, 11, 1), (5, -6, 13, -1), (7, -2, 9, 1), (11, 0, 9, -1), (31, 1, 5, 1)],
)
def test_volume_then_wta_and_fused(backend, size, smallest, disparities, direction):
    left, right = scene()
    ref, oth = (right, left) if direction == 1 else (left, right)
    mask = np.ones((HEIGHT, WIDTH), np.uint8)
    mask[30:, 40:] = 0
    radius = size // 2
    arrays, validity = prepared(backend, ref, oth, mask, radius)
    numbers = {
        "width": WIDTH,
        "height": HEIGHT,
        "smallest": smallest,
        "disparities": disparities,
        "direction": direction,
    }
    volume = junk(backend, (HEIGHT, WIDTH, disparities), np.float32)
    backend.launch("ncc_volume", **arrays, **numbers, radius=radius, volume_out=volume)
    expected = reference.ncc_volume(
        ref,
        oth,
        reference.window_norms(ref, mask, radius, 5.0)[2],
        reference.window_norms(oth, np.ones_like(mask), radius, 5.0)[2],
        smallest,
        disparities,
        radius,
        direction,
    )
    got = backend.download(volume)
    np.testing.assert_allclose(got, expected, atol=SCORE_TOLERANCE)
    assert (expected > 0.9).any()

    for subpixel in (0, 1):
        apart, fused = winners(backend, (HEIGHT, WIDTH)), winners(backend, (HEIGHT, WIDTH))
        backend.launch("wta", volume=volume, validity=validity, **numbers, subpixel=subpixel, **apart)
        backend.launch("ncc_wta", **arrays, validity=validity, **numbers, radius=radius, subpixel=subpixel, **fused)
        want = reference.wta(got.astype(float), backend.download(validity), smallest, direction, bool(subpixel))
        for form in (apart, fused):
            disparity, score, ratio, valid, key = (backend.download(a) for a in form.values())
            np.testing.assert_allclose(disparity, want[0], atol=DISPARITY_TOLERANCE)
            np.testing.assert_allclose(score, want[1], atol=1e-6)
            np.testing.assert_allclose(ratio, want[2], atol=1e-5)
            np.testing.assert_array_equal(valid, want[3])
            np.testing.assert_array_equal(key_index(key), want[4])
        # Both forms do the same arithmetic in the same order: not one bit may differ.
        for name in apart:
            np.testing.assert_array_equal(backend.download(apart[name]), backend.download(fused[name]))


@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (200, 1), (8, 700)])
def test_fused_on_extreme_shapes(backend, shape):
    rng = np.random.default_rng(3)
    ref, oth = (rng.integers(-128, 128, shape).astype(np.float32) for _ in range(2))
    mask = np.ones(shape, np.uint8)
    arrays, validity = prepared(backend, ref, oth, mask, 3, 1.0)
    numbers = {"width": shape[1], "height": shape[0], "smallest": -3, "disparities": 70, "direction": 1}
    volume = junk(backend, (*shape, 70), np.float32)
    backend.launch("ncc_volume", **arrays, **numbers, radius=3, volume_out=volume)
    apart, fused = winners(backend, shape), winners(backend, shape)
    backend.launch("wta", volume=volume, validity=validity, **numbers, subpixel=1, **apart)
    backend.launch("ncc_wta", **arrays, validity=validity, **numbers, radius=3, subpixel=1, **fused)
    for name in apart:
        np.testing.assert_array_equal(backend.download(apart[name]), backend.download(fused[name]))


def maps(shape=(HEIGHT, WIDTH), missing=0.3):
    """A disparity map with holes, jumps and outliers, and validity bits."""
    rng = np.random.default_rng(5)
    values = np.full(shape, 4.0, np.float32) + rng.normal(0, 0.3, shape).astype(np.float32)
    values[:, 25:] += 6
    values[rng.random(shape) < 0.15] += 3
    values[rng.random(shape) < missing] = np.nan
    validity = np.where(np.isnan(values), 1, 0).astype(np.uint8)
    values[:6, 40:60] = np.nan
    validity[:6, 40:60] = reference.MASKED
    return values, validity


def refined(backend, kernel, values, validity, **arguments):
    """What a kernel makes of a map and its validity."""
    outputs = [junk(backend, values.shape, dtype) for dtype in (np.float32, np.uint8)]
    backend.launch(
        kernel,
        disparity=backend.upload(values),
        validity=backend.upload(validity),
        width=values.shape[1],
        height=values.shape[0],
        **arguments,
        disparity_out=outputs[0],
        validity_out=outputs[1],
    )
    return [backend.download(output) for output in outputs]


# The last one is wider than the stretch of a row whose marks the form for CPUs holds.
@pytest.mark.parametrize("shape", [*SHAPES, (1, 4200)])
@pytest.mark.parametrize(("direction", "smallest"), [(1, 0), (-1, 0), (1, -5), (-1, 3)])
def test_consistency(backend, shape, direction, smallest):
    values, validity = maps(shape)
    other = np.random.default_rng(6).integers(-1, 14, shape)
    key = np.where(other >= 0, 5 * 128 + 127 - other, 0).astype(np.int32)
    numbers = {"smallest": smallest, "disparities": 14, "direction": direction, "tolerance": 1.5}
    got = refined(backend, "consistency", values, validity, other=backend.upload(key), **numbers)
    want = reference.consistency(values, other, validity, smallest, 14, direction, 1.5)
    np.testing.assert_array_equal(got[0], want[0])
    np.testing.assert_array_equal(got[1], want[1])
    if shape[1] > 14:
        assert {0, reference.OCCLUDED, reference.MISMATCH} <= set(np.unique(want[1]))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("missing", [0.0, 0.02, 0.6])
@pytest.mark.parametrize("size", [3, 5, 7])
def test_median(backend, shape, missing, size):
    values, _ = maps(shape, missing)
    out = junk(backend, shape, np.float32)
    held = backend.upload(values)
    backend.launch("median", disparity=held, width=shape[1], height=shape[0], size=size, disparity_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.median(values, size))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("reach", "step", "slope"), [(7, 3, 0.0), (7, 3, 0.5), (150, 50, 0.01), (1, 2, 0.0)])
def test_support(backend, shape, reach, step, slope):
    values, validity = maps(shape)
    numbers = {"reach": reach, "step": step, "tolerance": 1.0, "slope": slope}
    got = refined(backend, "support", values, validity, **numbers, share=0.3)
    want = reference.support(values, validity, reach, step, 1.0, slope, float(np.float32(0.3)))
    np.testing.assert_array_equal(got[0], want[0])
    np.testing.assert_array_equal(got[1], want[1])
    if shape == (HEIGHT, WIDTH) and step < reach:
        assert (want[1] != validity).any()


@pytest.mark.parametrize("shape", SHAPES)
def test_choose(backend, shape):
    rng = np.random.default_rng(9)

    def window_map(missing):
        values, validity = maps(shape, missing)
        return [values, *(rng.uniform(0, 1, shape).astype(np.float32) for _ in range(2)), validity]

    narrow, wide = window_map(0.5), window_map(0.2)
    names = ("disparity", "score", "ratio", "validity")
    out = {f"{name}_out": junk(backend, shape, array.dtype) for name, array in zip(names, narrow, strict=True)}
    backend.launch(
        "choose",
        **{name: backend.upload(array) for name, array in zip(names, narrow, strict=True)},
        **{f"wider_{name}": backend.upload(array) for name, array in zip(names, wide, strict=True)},
        width=shape[1],
        height=shape[0],
        **out,
    )
    for got, want in zip(out.values(), reference.choose(narrow, wide), strict=True):
        np.testing.assert_array_equal(backend.download(got), want)


# The last one is wider than the stretch of a row that the form for CPUs takes at a time.
@pytest.mark.parametrize("shape", [*SHAPES, (3, 2700)])
@pytest.mark.parametrize("radius", [0, 1, 4, 32])
def test_merge(backend, shape, radius):
    rng = np.random.default_rng(7)

    def summed(seed, missing):
        values, validity = maps(shape, missing)
        lowest = (rng.integers(0, 4400, shape) // 8).astype(np.float32)
        return [np.roll(values, seed, axis=1), lowest, np.roll(validity, seed, axis=1), rng.random(shape, np.float32)]

    ours, rivals = summed(0, 0.2), summed(1, 0.4)
    names = ("disparity", "lowest", "validity", "ratio")
    out = {f"{name}_out": junk(backend, shape, array.dtype) for name, array in zip(names, ours, strict=True)}
    backend.launch(
        "merge",
        **{name: backend.upload(array) for name, array in zip(names, ours, strict=True)},
        **{f"rival_{name}": backend.upload(array) for name, array in zip(names, rivals, strict=True)},
        width=shape[1],
        height=shape[0],
        radius=radius,
        margin=3.0,
        **out,
    )
    want = reference.merge(ours, rivals, radius, 3.0)
    for name, array in zip(names, want, strict=True):
        np.testing.assert_array_equal(backend.download(out[f"{name}_out"]), array, err_msg=name)
    if shape == (HEIGHT, WIDTH):
        chosen = want[3] == rivals[3]
        assert chosen.any() and not chosen.all()


@pytest.mark.parametrize("shape", [*SHAPES, (2, 2700)])
@pytest.mark.parametrize(("direction", "smallest"), [(1, 0), (-1, 0), (1, -5), (-1, 3)])
@pytest.mark.parametrize("tolerance", [0.0, 0.75, 2.5])
def test_agree(backend, shape, direction, smallest, tolerance):
    values, validity = maps(shape)
    rng = np.random.default_rng(6)
    other = rng.uniform(smallest, smallest + 20, shape).astype(np.float32)
    # Some agree, some of them just, and some sit on whole disparities.
    y, x = np.nonzero(~np.isnan(values) & (rng.random(shape) < 0.6))
    u = x + direction * np.floor(values[y, x] + 0.5).astype(int)
    inside = (u >= 0) & (u < shape[1])
    other[y[inside], u[inside]] = values[y[inside], x[inside]] + rng.choice([0, 0.75, -0.75, 1.0], inside.sum())
    other[rng.random(shape) < 0.3] = np.nan
    other = np.where(rng.random(shape) < 0.1, np.round(other), other).astype(np.float32)
    numbers = {"smallest": smallest, "disparities": 20, "direction": direction, "tolerance": tolerance}
    got = refined(backend, "agree", values, validity, other_disparity=backend.upload(other), **numbers)
    want = reference.agree(values, validity, other, smallest, 20, direction, tolerance)
    np.testing.assert_array_equal(got[0], want[0])
    np.testing.assert_array_equal(got[1], want[1])
    if shape == (HEIGHT, WIDTH):
        assert {0, reference.OCCLUDED, reference.MISMATCH, reference.MASKED} <= set(np.unique(want[1]))


@pytest.mark.parametrize("shape", [*SHAPES, (3, 2700)])
@pytest.mark.parametrize("missing", [0.0, 0.05, 0.3, 0.9])
@pytest.mark.parametrize("reach", [1, 4, 1 << 30])
@pytest.mark.parametrize(("near", "edges"), [(1, 0), (4, 1), (2, 0)])
@pytest.mark.parametrize("axis", [0, 1])
def test_fill(backend, shape, missing, reach, near, edges, axis):
    values, validity = maps(shape, missing)
    values[shape[0] // 2] = np.nan
    validity[shape[0] // 2] = reference.TEXTURELESS
    numbers = {"axis": axis, "reach": reach, "near": near, "edges": edges, "tolerance": 1.0}
    got = refined(backend, "fill", values, validity, **numbers)
    want = reference.fill(values, validity, **numbers)
    np.testing.assert_allclose(got[0], want[0], rtol=1e-6)
    np.testing.assert_array_equal(got[1], want[1])
    if shape == (HEIGHT, WIDTH) and (missing or axis):
        assert (want[1] & reference.FILLED).any()


@pytest.mark.parametrize("edges", [0, 1])
def test_fill_mirrors(backend, edges):
    values, validity = maps()
    numbers = {"axis": 0, "reach": 20, "near": 4, "edges": edges, "tolerance": 2.0}
    plain = refined(backend, "fill", values, validity, **numbers)
    mirrored = refined(backend, "fill", values[:, ::-1], validity[:, ::-1], **numbers)
    for one, two in zip(plain, mirrored, strict=True):
        np.testing.assert_array_equal(one, two[:, ::-1])


def test_fill_leaves_no_hole(backend):
    values, validity = maps((9, 40), 0.5)
    values[3:5] = np.nan  # rows in which there is nothing to take
    numbers = {"reach": 1 << 30, "near": 4, "edges": 1, "tolerance": 1.0}
    rows = refined(backend, "fill", values, validity, axis=0, **numbers)
    assert np.isnan(rows[0][3:5]).all()
    whole = refined(backend, "fill", *rows, axis=1, **numbers)
    np.testing.assert_array_equal(np.isnan(whole[0]), (validity & reference.MASKED) != 0)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_confidence(backend, shape, weight):
    rng = np.random.default_rng(8)
    score, ratio = (rng.uniform(-0.2, 1.2, shape).astype(np.float32) for _ in range(2))
    validity = (rng.random(shape) < 0.2).astype(np.uint8)
    out = junk(backend, shape, np.float32)
    backend.launch(
        "confidence",
        score=backend.upload(score),
        ratio=backend.upload(ratio),
        validity=backend.upload(validity),
        width=shape[1],
        height=shape[0],
        weight=weight,
        confidence_out=out,
    )
    np.testing.assert_allclose(backend.download(out), reference.confidence(score, ratio, validity, weight), atol=1e-6)


def test_masked(backend):
    mask = np.random.default_rng(4).integers(0, 3, (13, 29)).astype(np.uint8)
    out = junk(backend, mask.shape, np.uint8)
    backend.launch("masked", mask=backend.upload(mask), width=29, height=13, validity_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.masked(mask))
