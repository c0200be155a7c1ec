"""Load the service as its users would, and worse.

Without --rate: jobs posted by 16 clients, five tokens among them, while workers are killed at random and the server
three times, with SIGKILL; clients try again with the same Idempotency-Key. Every job must end once, in a model that is
to the byte what `reconstruct` and `save` make of the pair, and the table must be sound.

With --rate: how many jobs a second it does beside `stereo-gpu batch` on the same pairs in the same run, what a job
costs besides, how long it takes at half load, and how the memory grows.

The pairs are those of `tools/bench_chain`. Exit status 1 where a promise is broken.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
from pathlib import Path

from serve_load_chaos import load_in_chaos
from serve_load_rate import measure_rate

from stereo_gpu.bench.machine import describe_machine
from stereo_gpu.errors import StereoError


def main() -> int:
    """Run one of the two, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", action="store_true", help="measure instead of killing")
    parser.add_argument("--jobs", type=int, default=1000, help="in all (%(default)s)")
    parser.add_argument("--pairs", type=int, help="different ones among them (40; 200 with --rate)")
    parser.add_argument("--clients", type=int, default=16, help="that post at once (%(default)s)")
    parser.add_argument("--kill-every", type=float, default=5.0, metavar="S", help="a worker, on average (%(default)s)")
    parser.add_argument("--unwrap", choices=("view", "charts"), default="view", help="of the models (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of what is killed when (%(default)s)")
    parser.add_argument("--backend", help="where to compute; by default the best device")
    options = parser.parse_args()
    options.pairs = options.pairs or (200 if options.rate else 40)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # by way of what ends the server
    machine = describe_machine()
    print(f"{machine['processor']}; load average before it began: {os.getloadavg()[0]:.1f}", flush=True)
    try:
        with tempfile.TemporaryDirectory() as folder:
            broken = (measure_rate if options.rate else load_in_chaos)(options, Path(folder))
    except StereoError as error:
        print(error, file=sys.stderr)
        return 1
    for line in broken:
        print(f"BROKEN: {line}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
