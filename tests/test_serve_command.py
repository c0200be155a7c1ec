"""The command line of the service: started, asked, stopped; tokens, settings, logs; and doctor on its folder."""

import json
import logging
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from types import SimpleNamespace

import pytest
from conftest import missing

from stereo_gpu.cli import _parser, main
from stereo_gpu.commands.serve import _tell, read_settings
from stereo_gpu.errors import InputError

PROGRAM = [sys.executable, "-c", "import sys; from stereo_gpu.cli import main; sys.exit(main())"]


@pytest.fixture(autouse=True)
def extra():
    for name in ("fastapi", "uvicorn", "prometheus_client", "python_multipart"):
        try:
            __import__(name)
        except ModuleNotFoundError:
            missing("service", 'pip install "stereo-gpu[service]"')


def settings_of(*words):
    return read_settings(_parser().parse_args(["serve", "--data", "here", *words]))


def test_it_serves_until_it_is_told_to_stop(tmp_path, capsys):
    data = tmp_path / "data"
    command = [*PROGRAM, "serve", "--data", str(data), "--port", "0", "--engine", "inline", "--spare-gb", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        url, _, shown = line.split()[1].partition("/#token=")
        token = (data / "token").read_text().strip()
        assert line.startswith("open ") and str(data / "token") in line
        assert shown == "...", "a token that a pipe takes would lie in a log"
        with urllib.request.urlopen(f"{url}/healthz") as answer:
            assert json.load(answer) == {"status": "ok"}

        assert main(["serve", "--data", str(data), "--new-token", "bob"]) == 0
        bob = capsys.readouterr().out.strip()
        asked = urllib.request.Request(f"{url}/v1/jobs", headers={"Authorization": f"Bearer {bob}"})
        with urllib.request.urlopen(asked) as answer:
            assert json.load(answer)["items"] == []
        assert main(["serve", "--data", str(data), "--remove-token", "bob"]) == 0
        with pytest.raises(urllib.error.HTTPError, match="401") as refused:
            urllib.request.urlopen(asked)
        refused.value.close()

        assert main(["serve", "--data", str(data), "--port", "0"]) == 2
        assert f"process {process.pid} serves {data} already" in capsys.readouterr().err
        assert main(["doctor", "--data", str(data)]) == 0
        shown = capsys.readouterr().out
        assert f"ok    lock: process {process.pid} serves it" in shown and "ok    table: sound" in shown
    finally:
        process.send_signal(signal.SIGTERM)
        told = process.communicate(timeout=60)[1]
    assert process.returncode == 0, told
    entries = [json.loads(entry) for entry in told.splitlines()]
    assert any(entry["message"].startswith("serves at") for entry in entries)
    asked = next(entry for entry in entries if entry["message"].startswith("GET /v1/jobs 200"))
    assert asked["client"] == "bob" and asked["request"] and asked["level"] == "info"
    assert token not in told and bob not in told


def test_a_person_at_a_terminal_is_given_the_token(tmp_path, capsys, monkeypatch):
    service = SimpleNamespace(new_token="secret", folders=SimpleNamespace(token_file=tmp_path / "token"))
    settings = settings_of("--link", "https://models.example/")
    _tell(service, settings, "http://127.0.0.1:1")
    assert "secret" not in capsys.readouterr().out
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    _tell(service, settings, "http://127.0.0.1:1")
    assert "open  https://models.example/#token=secret\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        ([], "job_seconds", 600.0),
        (["--job-seconds", "none"], "job_seconds", None),
        (["--job-seconds", "5"], "job_seconds", 5.0),
        (["--job-memory", "2000"], "job_memory_mb", 2000),
        (["--job-memory", "none"], "job_memory_mb", None),
        (["--grace", "0"], "grace_seconds", 0.0),
        (["--keep-days", "0.5"], "keep_days", 0.5),
        (["--engine", "ray", "--address", "auto"], "address", "auto"),
    ],
)
def test_options_become_settings(words, name, value):
    assert getattr(settings_of(*words), name) == value


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--tries", "0"], "--tries 0: give a number of 1 or more"),
        (["--job-seconds", "-1"], "--job-seconds -1: give a number above 0"),
        (["--job-memory", "0"], "--job-memory 0: give a number above 0"),
        (["--keep-gb", "nan"], "--keep-gb nan"),
        (["--megapixels", "inf"], "--megapixels inf"),
        (["--grace", "-3"], "--grace -3"),
    ],
)
def test_settings_that_are_none(words, told):
    with pytest.raises(InputError, match=told):
        settings_of(*words)


def test_what_cannot_be_started_is_one_line(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("something")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("important")
    for words, told in (
        (["--data", str(file)], "another folder"),
        (["--data", str(tmp_path / "full")], "holds other files"),
        (["--data", str(tmp_path / "new"), "--new-token", "bob"], "start it there once"),
        (["--data", str(tmp_path / "d"), "--host", "no.such.host.invalid"], "give an address of this machine"),
        (["--data", str(tmp_path / "d"), "--port", "70000"], "port 70000"),
        (["--data", str(tmp_path / "d"), "--backend", "abacus"], "abacus"),
        (["--data", str(tmp_path / "d"), "--address", "auto"], "engine"),
    ):
        assert main(["serve", "--port", "0", *words]) == (1 if "abacus" in words else 2), words
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert error.startswith("stereo-gpu: error: ") and told in error, error
    assert (tmp_path / "full" / "thesis.txt").read_text() == "important"


def test_a_line_of_the_log_holds_what_is_known(capsys):
    from stereo_gpu.service.logs import show_logs

    logger = logging.getLogger("stereo_gpu.service")
    with show_logs(as_json=True):
        logger.warning("try %d lost:\nkilled", 2, extra={"job": "a" * 32})
        try:
            raise ValueError("odd")
        except ValueError:
            logger.exception("a fault")
        logger.debug("too much")
    lost, fault = (json.loads(line) for line in capsys.readouterr().err.splitlines())
    assert (lost["level"], lost["message"], lost["job"]) == ("warning", "try 2 lost:\nkilled", "a" * 32)
    assert lost["time"].endswith("Z") and "ValueError: odd" in fault["traceback"]
    with show_logs(as_json=False):
        logger.warning("try %d lost:\nkilled", 2, extra={"job": "b"})
    assert capsys.readouterr().err.endswith(" warning: try 2 lost: killed [job b]\n")


def test_doctor_tells_what_is_wrong_with_a_folder(tmp_path, capsys):
    from stereo_gpu.service.data.folders import Folders
    from stereo_gpu.service.store import Store

    data = tmp_path / "data"
    folders = Folders(data)
    with folders.own():
        store = Store(folders.database)
        folders.keep_token(store.add_client("owner"))
        store.close()
    data.chmod(0o755)
    folders.token_file.chmod(0o644)
    assert main(["doctor", "--data", str(data)]) == 0
    shown = capsys.readouterr().out
    assert f"mend: chmod 700 {data}" in shown and f"mend: chmod 600 {folders.token_file}" in shown
    with folders.database.open("r+b") as table:
        table.write(os.urandom(4096))
    assert main(["doctor", "--data", str(data)]) == 1
    shown = capsys.readouterr().out
    assert "FAIL  table: " in shown and "restore the folder from its backup" in shown
