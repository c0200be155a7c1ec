"""What the tests of worker processes have done there; they import it by name."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError


def double(value, *, plus=0):
    return 2 * value + plus


def sleep_then(seconds, value):
    time.sleep(seconds)
    return value, os.getpid()


def misbehave(what):
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "crash":
        os.abort()
    if what == "leave":
        os._exit(3)
    if what == "refuse":
        raise InputError("the pair is bad")
    if what == "fault":
        raise ZeroDivisionError("a fault")
    if what == "hang":
        time.sleep(60)
    if what == "print":
        print("noise on standard output", flush=True)
        os.system("echo noise from a child")
    if what == "unsendable":
        return lambda: None
    return what


def array_of(count, *, value):
    return np.full(count, value, np.uint8)


def environment(name):
    return os.environ.get(name)


def leave_a_file(folder, seconds):
    """Writes a file under a hidden name and takes its time, as a pair does that is interrupted."""
    from stereo_gpu.files import whole_folder

    with whole_folder(folder) as new:
        (new / "half").write_text("half")
        time.sleep(seconds)


class Held:
    """What is let go of slowly, as arrays on a device are."""

    def __init__(self, started=None):
        self.started = started

    def __reduce__(self):
        return int, (1,)

    def __del__(self):
        if self.started:
            self.started.write_text("")
        time.sleep(0.3)


def give_held():
    """Its own copy is let go of once the answer is sent."""
    return Held()


def fill_and_let_go(folder, started):
    """Fills a folder; where `started` is given, lets go of something first, and takes its time."""
    from stereo_gpu.files import whole_folder

    with whole_folder(folder):
        if started:
            Held(started)
            time.sleep(30)


def triangles(index, result):
    """What `then` may be: a small answer in place of a whole reconstruction."""
    return index, len(result.mesh.faces), os.getpid()


def memory(index, result):
    """What this process holds, bytes, once a pair is done."""
    import gc

    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
