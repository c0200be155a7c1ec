"""The matching kernels against the loops in reference.py, on every device: odd sizes, junk in the outputs."""

import numpy as np
import pytest
import reference

WIDTH, HEIGHT = 53, 37
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


def test_grey(backend):
    rng = np.random.default_rng(1)
    for picture, scale in (
        (rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), 1.0),
        (rng.integers(0, 256, (HEIGHT, WIDTH), np.uint8), 1.0),
        (rng.integers(0, 4096, (HEIGHT, WIDTH, 3), np.uint16), 255 / 4000),
    ):
        out = junk(backend, (HEIGHT, WIDTH), np.float32)
        channels = 1 if picture.ndim == 2 else 3
        held = backend.upload(picture)
        backend.launch("grey", picture=held, width=WIDTH, height=HEIGHT, channels=channels, scale=scale, grey_out=out)
        difference = np.abs(backend.download(out) - reference.grey(picture, scale))
        # Single and double precision may round a luma of exactly one half apart.
        assert (difference > 0).mean() < 0.002
        assert difference.max() <= 1


def test_smooth(backend):
    picture, _ = scene()
    weights = np.array([0.06, 0.24, 0.4, 0.24, 0.06], np.float32)
    arrays = [
        backend.upload(picture),
        junk(backend, picture.shape, np.float32),
        junk(backend, picture.shape, np.float32),
    ]
    for axis in (0, 1):
        backend.launch(
            "smooth",
            source=arrays[axis],
            weights=backend.upload(weights),
            width=WIDTH,
            height=HEIGHT,
            radius=2,
            axis=axis,
            smoothed_out=arrays[axis + 1],
        )
    difference = np.abs(backend.download(arrays[2]) - reference.smooth(picture, weights.astype(float)))
    assert (difference > 0).mean() < 0.002
    assert difference.max() <= 1


@pytest.mark.parametrize("size", [3, 11, 31])
def test_window_norms(backend, size):
    picture, _ = scene()
    mask = np.ones((HEIGHT, WIDTH), np.uint8)
    mask[:5, :9] = 0
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


def maps(seed=5):
    """A disparity map with holes, jumps and outliers, the other view's winners, and validity bits."""
    rng = np.random.default_rng(seed)
    values = np.full((HEIGHT, WIDTH), 4.0, np.float32) + rng.normal(0, 0.3, (HEIGHT, WIDTH)).astype(np.float32)
    values[:, 25:] += 6
    values[rng.random(values.shape) < 0.15] += 3
    values[rng.random(values.shape) < 0.3] = np.nan
    validity = np.where(np.isnan(values), 1, 0).astype(np.uint8)
    values[:6, 40:] = np.nan
    validity[:6, 40:] = reference.MASKED
    return values, validity


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_confidence(backend, weight):
    rng = np.random.default_rng(8)
    score, ratio = (rng.uniform(-0.2, 1.2, (HEIGHT, WIDTH)).astype(np.float32) for _ in range(2))
    validity = rng.choice([0, 0, 4, reference.FILLED], score.shape).astype(np.uint8)
    out = junk(backend, score.shape, np.float32)
    held = [backend.upload(a) for a in (score, ratio, validity)]
    names = dict(zip(("score", "ratio", "validity"), held, strict=True))
    backend.launch("confidence", **names, width=WIDTH, height=HEIGHT, weight=weight, confidence_out=out)
    want = reference.confidence(score.astype(float), ratio.astype(float), validity, weight)
    np.testing.assert_allclose(backend.download(out), want, atol=1e-6)
    assert (want == 0).any()
    assert (want == 1).any()


@pytest.mark.parametrize("direction", [1, -1])
def test_consistency(backend, direction):
    values, validity = maps()
    other = np.random.default_rng(6).integers(-1, 14, values.shape)
    key = np.where(other >= 0, 5 * 128 + 127 - other, 0).astype(np.int32)
    disparity_out = junk(backend, values.shape, np.float32)
    validity_out = junk(backend, values.shape, np.uint8)
    backend.launch(
        "consistency",
        disparity=backend.upload(values),
        other=backend.upload(key),
        validity=backend.upload(validity),
        width=WIDTH,
        height=HEIGHT,
        smallest=0,
        disparities=14,
        direction=direction,
        tolerance=1.5,
        disparity_out=disparity_out,
        validity_out=validity_out,
    )
    want = reference.consistency(values, other, validity, 0, 14, direction, 1.5)
    np.testing.assert_array_equal(backend.download(disparity_out), want[0])
    np.testing.assert_array_equal(backend.download(validity_out), want[1])
    assert {reference.OCCLUDED, reference.MISMATCH} <= set(np.unique(want[1]))


@pytest.mark.parametrize("size", [3, 5, 7])
def test_median(backend, size):
    values, _ = maps()
    out = junk(backend, values.shape, np.float32)
    held = backend.upload(values)
    backend.launch("median", disparity=held, width=WIDTH, height=HEIGHT, size=size, disparity_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.median(values, size))


@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_support(backend, slope):
    values, validity = maps()
    disparity_out = junk(backend, values.shape, np.float32)
    validity_out = junk(backend, values.shape, np.uint8)
    backend.launch(
        "support",
        disparity=backend.upload(values),
        validity=backend.upload(validity),
        width=WIDTH,
        height=HEIGHT,
        reach=7,
        step=3,
        tolerance=1.0,
        slope=slope,
        share=0.3,
        disparity_out=disparity_out,
        validity_out=validity_out,
    )
    want = reference.support(values, validity, 7, 3, 1.0, slope, float(np.float32(0.3)))
    np.testing.assert_array_equal(backend.download(disparity_out), want[0])
    np.testing.assert_array_equal(backend.download(validity_out), want[1])
    assert (want[1] != validity).any()


@pytest.mark.parametrize("reach", [1, 4, 100])
def test_fill(backend, reach):
    values, validity = maps()
    disparity_out = junk(backend, values.shape, np.float32)
    validity_out = junk(backend, values.shape, np.uint8)
    backend.launch(
        "fill",
        disparity=backend.upload(values),
        validity=backend.upload(validity),
        width=WIDTH,
        height=HEIGHT,
        reach=reach,
        tolerance=1.0,
        disparity_out=disparity_out,
        validity_out=validity_out,
    )
    want = reference.fill(values, validity, reach, 1.0)
    np.testing.assert_allclose(backend.download(disparity_out), want[0], rtol=1e-6)
    np.testing.assert_array_equal(backend.download(validity_out), want[1])
    assert (want[1] == reference.FILLED).any()
