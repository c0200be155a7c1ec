"""List what can compute here."""

from __future__ import annotations

import argparse


def add_options(parser: argparse.ArgumentParser) -> None:
    """Take nothing."""


def run(options: argparse.Namespace) -> None:
    """Print what can compute here."""
    from stereo_gpu.backends import devices

    for status in devices():
        state = "ready" if status.available else f"not usable: {status.reason}; mend: {status.remedy}"
        print(f"{status.name:<32} {status.kind}  {status.label}: {state}")
