"""Check the installation and every device, and say what would mend the rest."""

from __future__ import annotations

import argparse

from stereo_gpu.errors import StereoError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Take nothing."""


def run(options: argparse.Namespace) -> None:
    """Print what is well and what is not; raise if nothing can compute."""
    from stereo_gpu.doctor import examine

    healthy = True
    for finding in examine():
        healthy = healthy and (finding.good or not finding.needed)
        print(f"{'ok  ' if finding.good else 'FAIL' if finding.needed else 'no  '}  {finding.what}: {finding.detail}")
        if finding.remedy:
            print(f"      mend: {finding.remedy}")
    if not healthy:
        raise StereoError("something that every reconstruction needs is broken: see the lines marked FAIL")
