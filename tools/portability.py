"""Run the kernel tests on one OpenCL runtime after another, each alone in its own process, and print a table."""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from shutil import which

import pyopencl

ROOT = Path(__file__).parents[1]
# Both forms of every kernel, and the maps of all profiles.
TESTS = "tests/test_limited_devices.py"
SLOW_IN_OCLGRIND = ROOT / "tests" / "oclgrind.txt"
# Of the tests that were selected; some may ask for memory or a compiler that a runtime has not.
LEAST_PASSED = 0.95
COUNT = r"(\d+) (passed|failed|errors?|skipped|deselected|warnings?|xfailed|xpassed)"


@dataclass(frozen=True)
class Runtime:
    """One way to run OpenCL kernels on a CPU.

    Args:
        name: on the command line.
        title: in the table.
        platform: part of what the driver calls itself.
        library: what the ICD loader is to load; None where it is not there.
        get: how to get it.
        simulator: the command that runs a program with this runtime, in the place of an ICD.
    """

    name: str
    title: str
    platform: str
    library: Path | None
    get: str
    simulator: str | None = None

    @property
    def there(self) -> bool:
        """Whether it can be run."""
        return bool(self.library or self.simulator)


def runtimes() -> list[Runtime]:
    """The four runtimes, and where they are."""
    site = Path(pyopencl.__file__).parent
    system = ["/usr/lib/*/libpocl.so.2", "/usr/lib64/libpocl.so.2", "/usr/lib/libpocl.so.2"]
    return [
        Runtime(
            "pypi-pocl",
            "PoCL from PyPI",
            "Portable Computing Language",
            first(site / ".libs", "libpocl*.so*"),
            "pip install pocl-binary-distribution",
        ),
        Runtime(
            "system-pocl",
            "PoCL from Debian",
            "Portable Computing Language",
            next((path for pattern in system if (path := first(Path("/"), pattern[1:]))), None),
            "apt-get install --no-install-recommends libpocl2",
        ),
        Runtime(
            "intel",
            "Intel's from PyPI",
            "Intel(R) OpenCL",
            first(ROOT / ".portability" / "intel" / "lib", "libintelocl.so"),
            "pip install intel-opencl-rt intel-cmplr-lib-rt in .portability/intel",
        ),
        Runtime("oclgrind", "Oclgrind", "Oclgrind", None, "apt-get install oclgrind", which("oclgrind")),
    ]


def first(folder: Path, pattern: str) -> Path | None:
    """The first file that fits, by name."""
    return next(iter(sorted(folder.glob(pattern))), None)


def command_and_environment(runtime: Runtime, folder: Path, part: str) -> tuple[list[str], dict[str, str]]:
    """What to put before Python, and the environment, so that the runtime is the only one that it sees."""
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("OCL_ICD", "OPENCL_", "STEREO_GPU_BACKEND"))
    }
    environment["STEREO_GPU_REQUIRE"] = "opencl"
    if runtime.simulator:
        checks = ["--data-races", "--uninitialized", "--max-errors", "1000", "--log", str(folder / f"{part}.log")]
        return [runtime.simulator, *checks], environment
    assert runtime.library
    # Not a folder: the loader that comes with pyopencl would add the PoCL that lies beside it.
    icd = folder / f"{runtime.name}.icd"
    icd.write_text(f"{runtime.library}\n", "utf-8")
    environment["OCL_ICD_VENDORS"] = str(icd)
    environment["LD_LIBRARY_PATH"] = ":".join([str(runtime.library.parent), environment.get("LD_LIBRARY_PATH", "")])
    return [], environment


def device_of(runtime: Runtime, folder: Path) -> str:
    """Device and driver version in words.

    Raises:
        RuntimeError: the runtime does not start, or is not the only one there.
    """
    before, environment = command_and_environment(runtime, folder, "device")
    query = (
        "import pyopencl as cl; found = [d for p in cl.get_platforms() for d in p.get_devices()]; "
        "print(*(f'{d.platform.name}|{d.name.strip()}|{d.driver_version}' for d in found), sep=chr(10))"
    )
    done = subprocess.run([*before, sys.executable, "-c", query], env=environment, capture_output=True, text=True)
    lines = done.stdout.split("\n")[:-1]
    if done.returncode or len(lines) != 1 or runtime.platform not in lines[0]:
        raise RuntimeError((done.stderr.strip().split("\n")[-1] or " and ".join(lines) or "no device")[:100])
    _, name, version = lines[0].split("|")
    return f"{name} | {version}"


def run_tests(runtime: Runtime, folder: Path, part: str) -> tuple[bool, str]:
    """Run the tests of one form, or all; whether all passed, and what pytest and Oclgrind say."""
    before, environment = command_and_environment(runtime, folder, part)
    selected = part
    if runtime.simulator:
        lines = SLOW_IN_OCLGRIND.read_text("utf-8").split("\n")
        selected += "".join(f" and not ({line})" for line in lines if line and not line.startswith("#"))
    command = [*before, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", TESTS, "-k", selected]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    good, counts = verdict(done.returncode, done.stdout)
    if not good:
        print(done.stdout[-6000:], done.stderr[-2000:], sep="\n", file=sys.stderr)
    log = folder / f"{part}.log"
    said = log.read_text("utf-8", "replace").strip() if log.exists() else ""
    if runtime.simulator and not log.exists():
        return False, f"{counts}, Oclgrind wrote no log"
    if said:
        print(said[:6000], file=sys.stderr)
        return False, f"{counts}, Oclgrind reports {said.count('Kernel: ')}"
    return good, counts


def verdict(status: int, output: str) -> tuple[bool, str]:
    """Whether a run of pytest counts as passed, and why or how: from its exit status and all that it printed."""
    # A launcher such as Oclgrind's, or a shell, tells of a signal by 128 and its number.
    if (number := -status if status < 0 else status - 128) > 0:
        known = number in set(signal.Signals)
        return False, f"crashed (signal {number}{', ' + signal.Signals(number).name if known else ''})"
    # The last line that is a summary, such as "1 failed, 2 passed in 3.45s": a driver may print after it.
    summaries = re.findall(rf"^=*\s*((?:{COUNT}(?:, )?)+) in [\d.]+s", output, re.MULTILINE)
    if not summaries:
        return False, "no test ran" if status == 5 else f"no result (exit status {status})"
    numbers = {what.rstrip("s"): int(number) for number, what in re.findall(COUNT, summaries[-1][0])}
    counts = ", ".join(f"{n} {what}" for what, n in numbers.items() if what in ("passed", "failed", "error", "skipped"))
    passed, skipped = numbers.get("passed", 0), numbers.get("skipped", 0)
    if status or not passed:
        return False, counts or "no test ran"
    if passed < LEAST_PASSED * (passed + skipped):
        return False, f"{counts}: too few ran"
    return True, counts


def main() -> int:
    """Print the table; 1 where a runtime that is there fails, one that was named is not there, or none is there."""
    known = {runtime.name: runtime for runtime in runtimes()}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="RUNTIME", choices=[[], *known], help=", ".join(known))
    parser.add_argument("--has", choices=known, help="only tell by the exit status whether a runtime is there")
    options = parser.parse_args()
    if options.has:
        return 0 if known[options.has].there else 1
    rows, failed = [("runtime", "device | driver", "tests", "seconds")], False
    for name in options.names or known:
        runtime = known[name]
        if not runtime.there:
            rows.append((runtime.title, "not there", f"tools/portability --install {name} ({runtime.get})", ""))
            failed |= bool(options.names)
            continue
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            try:
                device = device_of(runtime, folder)
                # Oclgrind takes minutes: a form a core.
                parts = ("gpu", "cpu") if runtime.simulator else ("gpu or cpu",)
                with ThreadPoolExecutor() as pool:
                    results = list(pool.map(lambda part, r=runtime, f=folder: run_tests(r, f, part), parts))
                good, said = all(good for good, _ in results), "; ".join(text for _, text in results)
            except RuntimeError as error:
                device, good, said = "does not start", False, str(error)
        failed |= not good
        rows.append((runtime.title, device, said if good else f"FAILED: {said}", f"{time.monotonic() - began:.0f}"))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    if not any(known[name].there for name in options.names or known):
        print("none of these runtimes is there, so nothing was tested", file=sys.stderr)
        failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
