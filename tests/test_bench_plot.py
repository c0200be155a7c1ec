"""The benchmark's pictures and page, and the document made of a run."""

import importlib.util
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from bench_runs import made_up_run
from conftest import need_matplotlib

from stereo_gpu.cli import main

GENERATOR = Path(__file__).parents[1] / "tools" / "performance.py"


@pytest.fixture
def run_file(tmp_path):
    made_up_run().save(tmp_path / "run.json")
    return str(tmp_path / "run.json")


def test_pictures_and_page(run_file, tmp_path, capsys):
    need_matplotlib()
    assert main(["bench", "--load", run_file, "--plot", str(tmp_path / "plots")]) == 0
    assert "bench.html" in capsys.readouterr().out
    for name in ("roofline", "speed", "peers"):
        picture = cv2.imread(str(tmp_path / "plots" / f"{name}.png"))
        assert picture.shape[0] > 250 and picture.shape[1] > 700
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    text = (tmp_path / "plots" / "bench.html").read_text("utf-8")
    assert text.count("data:image/png;base64,") == 3
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert "ncc_wta" in text and "not run: needs 9 bytes &lt;here&gt;" in text


def test_without_matplotlib_nothing_is_timed(run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["bench", "--load", run_file, "--plot", str(tmp_path / "plots")]) == 1
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "pip install 'stereo-gpu[plot]'" in said.err
    assert not (tmp_path / "plots").exists()


def load_generator():
    spec = importlib.util.spec_from_file_location("performance", GENERATOR)
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    return generator


@pytest.mark.skipif(not GENERATOR.is_file(), reason="tools/performance.py is in the checkout only")
@pytest.mark.parametrize(
    ("seconds", "load", "says"),
    [
        (5.0, 0.1, ""),
        (5.0, None, ""),
        (5.0, 2.0, ""),
        (0.3, 0.1, "**A quick run: 0.3 s a case where 5 s are usual, so "),
        (5.0, 2.1, "**A quick run: a load of 2.1 on 2 cores before it began, so "),
        (
            0.3,
            6.2,
            "**A quick run: 0.3 s a case where 5 s are usual, and a load of 6.2 on 2 cores before it began, so ",
        ),
    ],
)
def test_the_document_says_at_its_top_that_a_run_was_quick(seconds, load, says):
    run = made_up_run()
    run.method["seconds"], run.machine["load_average"] = seconds, load
    top = load_generator().markdown(run).split("## Ratios")[0]
    assert says in top and ("quick run" in top) == bool(says)


@pytest.mark.skipif(not GENERATOR.is_file(), reason="tools/performance.py is in the checkout only")
def test_the_document_has_the_ratios_first(run_file, tmp_path, monkeypatch):
    need_matplotlib()
    (tmp_path / "docs" / "images").mkdir(parents=True)
    generator = load_generator()
    monkeypatch.setattr(sys, "argv", ["performance", "--load", run_file, "--docs", str(tmp_path / "docs")])
    assert generator.main() == 0
    text = (tmp_path / "docs" / "performance.md").read_text("utf-8")
    headings = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert headings[:2] == ["Ratios", "The machine"]
    assert "| `ncc_wta` | StereoBM | 0.40 | 0.40 |" in text
    assert "| `match precise` | SGBM HH | not run | - |" in text
    assert "- a processor, 2 cores, 8 GiB, Linux 6.1 x86_64" in text
    for name in re.findall(r"\]\(((?:images/|performance)[^)#]+)\)", text):
        assert (tmp_path / "docs" / name).is_file(), name
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in block.splitlines()}) == 1
