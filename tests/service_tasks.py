"""What tests have a service's workers do in place of a reconstruction, by what the job's options say."""

import os
import signal
import time

from stereo_gpu.errors import BackendError, InputError, StageError
from stereo_gpu.files import whole_folder, write_whole
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.jobs.outcome import Outcome


def refuse_to_begin(*, data):
    raise BackendError("the device is gone")


def do(order, *, data, tell):
    """Write one file, and before that `do`: a word, or one for each try; the last one holds for all that follow."""
    folders = Folders(data)
    count = data / "begun" / order.job
    count.parent.mkdir(exist_ok=True)
    with count.open("a") as stream:
        stream.write(f"{order.check}\n")
    words = order.options.get("do", ["nothing"])
    word = words[min(len(count.read_text().splitlines()), len(words)) - 1]
    tell("read")
    if word == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if word == "refuse":
        raise InputError("the pair\nis bad")
    if word == "device":
        raise BackendError("the device hiccupped")
    if word == "nothing to do":
        raise StageError("nothing was left")
    if word == "slow":
        (data / "slow").touch()
        for _ in range(2000):
            time.sleep(0.01)
            tell("match")
    attempt = folders.attempt(order.job, order.number)
    with whole_folder(attempt) as new:
        outcome = Outcome(
            summary={"odd": object()} if word == "odd" else {"triangles": 3},
            warnings=("look",),
            seconds={"read": 0.5},
            checked=order.check == "full",
        )
        write_whole(new / "model.glb", os.urandom(100))
        if word != "odd":
            import json

            write_whole(new / "result.json", json.dumps(outcome.as_json()))
    if word != "torn":
        folders.seal(attempt)
    return {"outcome": outcome, "device": ("a GPU", 5)}
