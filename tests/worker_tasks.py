"""What the tests of worker processes have done there; they import it by name."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError


def double(value, *, plus=0):
    return 2 * value + plus


def sleep_then(seconds, value):
    time.sleep(seconds)
    return value, os.getpid()


def meet(folder, count):
    """Ends once so many processes are here at the same time."""
    (folder / str(os.getpid())).touch()
    while len(list(folder.iterdir())) < count:
        time.sleep(0.01)
    return os.getpid()


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


PREPARED = []  # in each process anew


def prepare(*, mark):
    """What is done before the first job."""
    PREPARED.append(mark)


def prepared(value, *, mark):
    """What was prepared in this process before this job."""
    return value, mark, list(PREPARED), os.getpid()


def refuse_to_prepare(*, broken):
    if broken:
        raise RuntimeError("no device\nis left")


def which(value, *, broken):
    return value, broken


def prepare_slowly():
    time.sleep(1.0)


def fail_when_stopped():
    """What an extension does whose import is cut off."""
    try:
        time.sleep(60)
    except SystemExit:
        os.write(2, b"Critical error of an extension\n")
        raise ImportError("it failed for many reasons") from None


def answer(value):
    return value


def go_through(stages, *, tell):
    """Tells stages as they come, each (name, seconds); "well" where it comes to its end."""
    for name, seconds in stages:
        tell(name)
        time.sleep(seconds)
    return "well"


def take_time(seconds, started=None, *, tell):
    """Tells many stages, so that every engine can stop it."""
    if started is not None:
        Path(started).write_text(str(os.getpid()))
    for _ in range(round(seconds / 0.02)):
        tell("on")
        time.sleep(0.02)
    return "well"


def tell_late(seconds, *, tell):
    """Leaves a thread that tells something once this is over."""
    if seconds:
        threading.Timer(seconds, tell, ("late",)).start()
    return "well"


def read_input():
    """What is there to be read for a debugger, or for a program that a task starts."""
    return sys.stdin.read() + subprocess.run(["cat"], stdout=subprocess.PIPE, text=True, check=True).stdout


def grow(megabytes, *, tell):
    """Holds more and more memory."""
    held = []
    for _ in range(megabytes // 20):
        held.append(np.ones(20 << 20, np.uint8))
        tell("on")
        time.sleep(0.02)
    return len(held)


def grow_in_a_child(megabytes):
    """Has a process of its own hold the memory."""
    script = f"import time; held = bytearray(b'1') * ({megabytes} << 20); time.sleep(30)"
    subprocess.run([sys.executable, "-c", script], check=True)


def die_at_first(folder, times):
    """Ends its process so many times, before it goes well; `folder` counts."""
    tries = len(list(folder.iterdir()))
    (folder / str(tries)).touch()
    if tries < times:
        os.kill(os.getpid(), signal.SIGKILL)
    return tries + 1


def hold_on(started):
    """Does not end when it is asked to."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    started.write_text(str(os.getpid()))
    time.sleep(60)


def hold_and_refuse(count):
    held = np.ones(count)
    raise InputError(f"{len(held)} are too many")


def refuse_and_count(folder):
    """Is refused, and leaves one file more."""
    (folder / str(len(list(folder.iterdir())))).touch()
    raise InputError("the pair is bad")
