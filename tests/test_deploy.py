"""What stands in deploy/ says what the command line takes; neither the unit nor the image can be started here."""

import configparser
import re
import shutil
import subprocess
from pathlib import Path

from conftest import missing

from stereo_gpu.cli import _parser
from stereo_gpu.commands.serve import read_settings

DEPLOY = Path(__file__).parents[1] / "deploy"
UNIT = DEPLOY / "stereo-gpu.service"


def read_unit():
    class Repeated(dict):
        def __setitem__(self, key, value):
            super().__setitem__(key, [*self[key], *value] if key in self and isinstance(value, list) else value)

    parser = configparser.RawConfigParser(strict=False, dict_type=Repeated, delimiters="=", interpolation=None)
    parser.optionxform = str
    parser.read_string(UNIT.read_text())
    return parser


def test_the_unit_starts_what_there_is_and_shuts_it_in():
    unit = read_unit()
    service = unit["Service"]
    words = service["ExecStart"].split("\n")[0].split()
    assert words[0].endswith("/bin/stereo-gpu") and words[-1] == "$STEREO_GPU_OPTIONS"
    options = _parser().parse_args(words[1:-1])
    assert options.data == Path("/var/lib/stereo-gpu") and options.json_logs is True
    assert service["StateDirectory"] == "stereo-gpu" and service["User"] != "root"
    for name in ("NoNewPrivileges", "ProtectHome", "PrivateTmp", "RestrictNamespaces"):
        assert service[name] == "yes"
    assert service["ProtectSystem"] == "strict" and service["UMask"] == "0077"
    assert "MemoryDenyWriteExecute" not in service  # kernels are compiled while it runs
    grace = read_settings(options).grace_seconds
    assert float(service["TimeoutStopSec"]) > grace and service["KillMode"] == "mixed"


def test_systemd_finds_nothing_wrong_with_the_unit(tmp_path):
    if not (verify := shutil.which("systemd-analyze")):
        missing("systemd-analyze", "not installed; it comes with systemd")
    # The program need not be installed where the unit looks for it.
    unit = tmp_path / UNIT.name
    unit.write_text(re.sub(r"(ExecStart=)\S+", r"\1/bin/true", UNIT.read_text()))
    done = subprocess.run([verify, "verify", "--man=no", str(unit)], capture_output=True, text=True)
    ours = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert not ours, ours


def test_the_image_runs_as_a_user_and_copies_what_is_there():
    lines = re.sub(r"\\\n", " ", (DEPLOY / "Dockerfile").read_text()).splitlines()
    steps = [line.split(None, 1) for line in lines if line.strip() and not line.startswith("#")]
    steps = [(word, rest) for word, rest in steps if word.isupper()]
    assert {word for word, _ in steps} <= {
        *("FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "STOPSIGNAL", "HEALTHCHECK"),
        "ENTRYPOINT",
    }
    ignored = (DEPLOY.parent / ".dockerignore").read_text().split()
    for word, rest in steps:
        if word == "COPY" and not rest.startswith("--from"):
            for source in rest.split()[:-1]:
                assert (DEPLOY.parent / source).exists() and f"!{source}" in ignored, source
    users = [rest for word, rest in steps if word == "USER"]
    assert users and users[-1] != "root"
    (entry,) = (rest for word, rest in steps if word == "ENTRYPOINT")
    words = re.findall(r'"([^"]*)"', entry)
    options = _parser().parse_args(words[1:])
    assert words[0] == "stereo-gpu" and str(options.data) == "/data" and options.json_logs is True
    (check,) = (rest for word, rest in steps if word == "HEALTHCHECK")
    assert f"http://127.0.0.1:{options.port}/healthz" in check
