"""Check the installation and every device, and say what would mend the rest."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.errors import StereoError

if TYPE_CHECKING:
    from stereo_gpu.doctor import Finding


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument("--data", type=Path, metavar="DIR", help="the folder of a service, to look over it, too")
    parser.add_argument("--port", type=int, default=8000, help="of that service (%(default)s)")


def run(options: argparse.Namespace) -> None:
    """Print what is well and what is not; raise if nothing can compute."""
    from stereo_gpu.doctor import examine

    healthy = True
    of_service: Iterator[Finding] = iter(())
    if options.data is not None:
        from stereo_gpu.service.doctor import examine_service
        from stereo_gpu.service.settings import Settings

        of_service = examine_service(Settings(data=options.data, port=options.port))
    for finding in chain(examine(), of_service):
        healthy = healthy and (finding.good or not finding.needed)
        print(f"{'ok  ' if finding.good else 'FAIL' if finding.needed else 'no  '}  {finding.what}: {finding.detail}")
        if finding.remedy:
            print(f"      mend: {finding.remedy}")
    if not healthy:
        raise StereoError("something that is needed is broken: see the lines marked FAIL")
