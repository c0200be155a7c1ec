"""What makes a texture, against the loops in reference.py, on every device."""

import numpy as np
import pytest
import reference

WIDTH, HEIGHT = 41, 29
# Single precision places a sample to about 1e-4 px, and its products of numbers up to 65535 to a hundredth of a unit.
PLACE_OFF = 2e-3
LIGHT_OFF = 1 + 65535 * 4e-4


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def light(shape, seed, gaps=0.0):
    """Light with some texels missing."""
    rng = np.random.default_rng(seed)
    out = rng.integers(0, 65536, (*shape, 4)).astype(np.uint16)
    out[..., 3] = 65535
    out[rng.random(shape) < gaps] = 0
    return out


def places(shape, source, seed):
    """Places all over a picture and a little beyond it, on its pixels' centres too, and some that are none."""
    rng = np.random.default_rng(seed)
    out = np.stack([rng.uniform(-2, source[1] + 1, shape), rng.uniform(-2, source[0] + 1, shape)])
    out[:, ::3] = np.round(out[:, ::3])
    out[:, rng.random(shape) < 0.2] = np.nan
    return out.astype(np.float32)


def test_cover_and_place(backend):
    size = (33, 27)
    corners = np.array(
        [
            [[2.2, 3.1, 0, 0, 1], [20.4, 4.7, 38, 3, 1.2], [5.3, 22.8, 2, 27, 1]],
            [[22.6, 6.1, 39, 2, 1.5], [31.2, 25.9, 39, 27, 1.1], [8.3, 24.8, 3, 28, 0.9]],
            [[1, 1, 5, 5, 1], [1, 1, 5, 5, 1], [1, 1, 5, 5, 1]],
            [[28.1, 1.2, 3, 3, 1], [31.9, 1.3, 8, 3, 40], [30.1, 1.9, 6, 4, 3]],
        ]
    )
    held, atlas = backend.upload(corners.astype(np.float32)), {"texture_width": size[0], "texture_height": size[1]}
    owner = backend.zeros((size[1], size[0]), np.int32)
    backend.launch("cover", corners=held, triangles=len(corners), reach=2.25, **atlas, owner_out=owner)
    got, want = backend.download(owner), reference.cover(corners, size, 2.25)
    assert (got != want).mean() < 0.005  # a texel centre on an edge may fall on either side
    for place in (reference.INSIDE, reference.CLOSE, 0):
        assert set(np.unique(want[want > 0] - place)) >= {1, 2, 4}

    found = junk(backend, (2, size[1], size[0]), np.float32)
    backend.launch("place", corners=held, owner=owner, margin=0.75, **atlas, place_out=found)
    want = reference.place(corners, got, 0.75, size)
    assert 0.3 < np.isfinite(want).mean() < 0.9
    assert (want[0] == corners[3, :, 2].min() - 0.75).any()  # what is seen edge on is held back
    np.testing.assert_allclose(backend.download(found), want, atol=PLACE_OFF)


def test_cover_without_reach(backend):
    corners = np.array([[[3.3, 2.1, 0, 0, 1], [15.1, 6.3, 0, 0, 1], [4.2, 13.7, 0, 0, 1]]])
    owner = backend.zeros((16, 18), np.int32)
    backend.launch(
        "cover",
        corners=backend.upload(corners.astype(np.float32)),
        triangles=1,
        reach=0.0,
        texture_width=18,
        texture_height=16,
        owner_out=owner,
    )
    np.testing.assert_array_equal(backend.download(owner), reference.cover(corners, (18, 16), 0.0))


@pytest.mark.parametrize(
    ("cell", "bias", "gain"), [(1.0, 0.0, 1.0), (1.0, 32768.0, 3.0), (2.0, 0.0, 1.0)], ids=["whole", "more", "coarse"]
)
def test_bake(backend, cell, bias, gain):
    source, shape = light((HEIGHT, WIDTH), 2), (27, 33)
    wide = (int(HEIGHT * cell), int(WIDTH * cell))
    where, before = places(shape, wide, 3), light(shape, 4)
    before[..., 3] = 0
    if gain == 1:
        before[:] = 0
    texture = backend.upload(before)
    backend.launch(
        "bake",
        light=backend.upload(source),
        places=backend.upload(where),
        width=WIDTH,
        height=HEIGHT,
        cell=cell,
        bias=bias,
        gain=gain,
        texture_width=shape[1],
        texture_height=shape[0],
        texture_out=texture,
    )
    want = reference.bake(source, where, cell, bias, gain, before)
    got = backend.download(texture)
    there = np.isfinite(where[0])
    np.testing.assert_array_equal(got[~there], before[~there])
    assert (got[there][:, 3] == 65535).all()
    assert np.abs(got.astype(int) - want.astype(int)).max() <= LIGHT_OFF * gain
    if (cell, gain) == (1, 1):
        # Where centres meet, a texel is a copy of its pixel.
        y, x = np.nonzero((where == np.round(where)).all(axis=0))
        u, v = np.clip(where[0, y, x].astype(int), 0, WIDTH - 1), np.clip(where[1, y, x].astype(int), 0, HEIGHT - 1)
        assert len(y) > 100
        np.testing.assert_array_equal(got[y, x], source[v, u])


def test_residual(backend):
    shown, texture = light((HEIGHT, WIDTH), 5), light((27, 33), 6, gaps=0.05)
    where = places((HEIGHT, WIDTH), (27, 33), 7)
    out = junk(backend, shown.shape, np.uint16)
    backend.launch(
        "residual",
        light=backend.upload(shown),
        texture=backend.upload(texture),
        places=backend.upload(where),
        texture_width=33,
        texture_height=27,
        width=WIDTH,
        height=HEIGHT,
        residual_out=out,
    )
    want = reference.residual(shown, texture, where)
    assert 0.3 < (want == 32768).all(axis=2).mean() < 0.7
    assert np.abs(backend.download(out).astype(int) - want.astype(int)).max() <= LIGHT_OFF


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_decode(backend, dtype, channels):
    rng = np.random.default_rng(8)
    largest = int(np.iinfo(dtype).max)
    table = rng.integers(0, 65536, largest + 1).astype(np.uint16)
    picture = rng.integers(0, largest + 1, (HEIGHT, WIDTH, channels)).astype(dtype)
    out = junk(backend, (HEIGHT, WIDTH, 4), np.uint16)
    valid = (rng.random((HEIGHT, WIDTH)) < 0.8).astype(np.uint8)
    given = {name: backend.upload(v) for name, v in (("picture", picture), ("valid", valid), ("table", table))}
    backend.launch("decode", **given, width=WIDTH, height=HEIGHT, channels=channels, light_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.decode(picture, valid, table))


def test_encode(backend):
    table = np.random.default_rng(9).integers(0, 256, 65536).astype(np.uint8)
    source, out = light((HEIGHT, WIDTH), 10), junk(backend, (HEIGHT, WIDTH, 3), np.uint8)
    given = {"light": backend.upload(source), "table": backend.upload(table)}
    backend.launch("encode", **given, width=WIDTH, height=HEIGHT, picture_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.encode(source, table))


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (7, 4), (41, 29)])
def test_pull_and_push(backend, size):
    width, height = -(-size[0] // 2), -(-size[1] // 2)
    fine = light(size[::-1], 11, gaps=0.6)
    coarse = junk(backend, (height, width, 4), np.uint16)
    held = backend.upload(fine)
    given = {"fine_width": size[0], "fine_height": size[1], "width": width, "height": height}
    backend.launch("pull", fine=held, **given, coarse_out=coarse)
    want = reference.pull(fine)
    np.testing.assert_array_equal(backend.download(coarse), want)
    given = {"coarse_width": width, "width": size[0], "height": size[1]}
    backend.launch("push", coarse=coarse, **given, fine_out=held)
    np.testing.assert_array_equal(backend.download(held), reference.push(want, fine))
