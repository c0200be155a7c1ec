"""Folders and manifests name the pairs that they should, and what is wrong with them is told."""

import pytest

from stereo_gpu.batching.pair_list import list_pairs
from stereo_gpu.errors import InputError


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")


def named(pairs, folder):
    return [(pair.name, str(pair.left.relative_to(folder)), str(pair.right.relative_to(folder))) for pair in pairs]


def test_a_folder_as_capture_leaves_it(tmp_path):
    touch(tmp_path, "left0001.png", "right0001.png", "left0002.png", "right0002.png", "notes.txt")
    expected = [("0001", "left0001.png", "right0001.png"), ("0002", "left0002.png", "right0002.png")]
    assert named(list_pairs(tmp_path), tmp_path) == expected
    line = '{{"number": {0}, "left": "left000{0}.png", "right": "right000{0}.png", "skew_ms": 1.5}}\n'
    (tmp_path / "pairs.jsonl").write_text(line.format(2) + "\n" + line.format(1))
    assert named(list_pairs(tmp_path), tmp_path) == expected[::-1]


def test_folders_left_and_right(tmp_path):
    touch(tmp_path, "left/b.jpg", "left/a.png", "right/a.PNG", "right/b.tif")
    assert named(list_pairs(tmp_path), tmp_path) == [
        ("a", "left/a.png", "right/a.PNG"),
        ("b", "left/b.jpg", "right/b.tif"),
    ]


def test_a_folder_a_pair(tmp_path):
    touch(tmp_path, "cup/left.png", "cup/right.png", "bear/left_cam.png", "bear/right_cam.png", "empty/notes.txt")
    assert named(list_pairs(tmp_path), tmp_path) == [
        ("bear", "bear/left_cam.png", "bear/right_cam.png"),
        ("cup", "cup/left.png", "cup/right.png"),
    ]


def test_a_picture_alone_is_a_pair_that_will_fail(tmp_path):
    touch(tmp_path, "left1.png", "right1.png", "left2.png", "right3.png")
    assert named(list_pairs(tmp_path), tmp_path) == [
        ("1", "left1.png", "right1.png"),
        ("2", "left2.png", "right2.png"),
        ("3", "left3.png", "right3.png"),
    ]
    touch(tmp_path, "sides/left/a.png", "sides/right/b.png")
    assert [pair.right.name for pair in list_pairs(tmp_path / "sides")] == ["a.png", "b.png"]


def test_manifests(tmp_path):
    table = tmp_path / "pairs.csv"
    table.write_text("a/left.png, a/right.png\n\nl2.png,r2.png,second,m2.png\n")
    first, second = list_pairs(table)
    assert (first.name, first.left, first.mask) == ("a", tmp_path / "a" / "left.png", None)
    assert (second.name, second.right, second.mask) == ("second", tmp_path / "r2.png", tmp_path / "m2.png")
    table.write_bytes('\ufeffName,Right,LEFT,taken\r\n"x, y",r.png,l.png,today\r\n'.encode())
    (pair,) = list_pairs(table)
    assert (pair.name, pair.left.name, pair.right.name) == ("x, y", "l.png", "r.png")
    lines = tmp_path / "pairs.jsonl"
    lines.write_text('{"left": "/far/l.png", "right": "r.png", "name": "n", "mask": "m.png"}\n')
    (pair,) = list_pairs(lines)
    assert (str(pair.left), pair.mask) == ("/far/l.png", tmp_path / "m.png")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "names no pair"),
        ("left.png\n", "line 1 has right = None"),
        ("a.png,b.png\na.png,c.png\n", "two pairs of the name 'a'"),
        ("a.png,b.png,../up\n", "cannot be a folder's name"),
        ("a.png,b.png,.hidden\n", "cannot be a folder's name"),
        ("a.png,b.png," + "n" * 300 + "\n", "cannot be a folder's name"),
        ("a.png,b.png,failed.jsonl\n", "cannot be a folder's name"),
        ('a.png,"b.png\n', "is no CSV"),
        ('a.png,b.png\n"c.png" ,d.png\n', "line 2 is no CSV"),
        ("a\0.png,b.png\n", "zero byte"),
        ('{"left": "a.png"}\n', "line 1 has right = None"),
        ('{"left": "a.png", "right": 5}\n', "line 1 has right = 5"),
        ('{"left": "a.png", "right": "b.png", "name": "\\ud800"}\n', "cannot be a folder's name"),
        ('{"left": \n', "line 1 is no JSON"),
        ('{"left": "a.png", "right": "b.png"}\n[1]\n', "line 2 is"),
    ],
)
def test_a_manifest_that_is_wrong_is_refused_in_one_line(tmp_path, text, message):
    manifest = tmp_path / "manifest"
    manifest.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        list_pairs(manifest)
    assert "\n" not in str(refused.value) and "manifest" in str(refused.value)


def test_what_is_no_manifest_is_refused(tmp_path):
    array = tmp_path / "pairs.json"
    array.write_text('[{"left": "a.png", "right": "b.png"}]')
    with pytest.raises(InputError, match=r'line 1 is .* give \{"left": \.\.\., "right": \.\.\.\}'):
        list_pairs(array)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        list_pairs(tmp_path / "none")
    with pytest.raises(InputError, match="names no pair"):
        list_pairs(tmp_path)
    picture = tmp_path / "left.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(InputError, match="is no text in UTF-8"):
        list_pairs(picture)
