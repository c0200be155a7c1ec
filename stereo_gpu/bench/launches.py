"""Catch a kernel's launch out of the stage that makes it, so that it is timed with the arguments it really gets."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from stereo_gpu.backends import Backend, DeviceArray

Arguments = dict[str, DeviceArray | int | float]
# Outputs that are added to or raised, and so are read too.
ADDED_TO = {"ncc_wta": "other_out", "wta": "other_out"}


class _CaughtError(Exception):
    """Ends the stage once its launches are caught."""


class _Recorder:
    """A device that runs what a stage launches before the wanted kernel, and keeps the wanted launches."""

    def __init__(self, device: Backend, kernel: str, count: int) -> None:
        self._device, self._kernel, self._count = device, kernel, count
        self.caught: list[Arguments] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def launch(self, kernel: str, **arguments: DeviceArray | int | float) -> None:
        if kernel == self._kernel:
            self.caught.append(arguments)
            if len(self.caught) == self._count:
                raise _CaughtError
        self._device.launch(kernel, **arguments)


def catch_launches(device: Backend, kernel: str, stage: Callable[[Backend], object], count: int = 1) -> list[Arguments]:
    """Run a stage up to a kernel's launch and return that launch's arguments, which stay on the device.

    Args:
        device: where to run.
        kernel: the wanted one.
        stage: runs on the device that it is given.
        count: how many launches of the kernel belong together; a stage may make fewer.

    Raises:
        ValueError: the stage never launches it.
    """
    recorder = _Recorder(device, kernel, count)
    with suppress(_CaughtError):
        stage(cast(Backend, recorder))
    # What comes before may still run, and must not be timed with the wanted kernel.
    device.finish()
    if not recorder.caught:
        raise ValueError(f"its stage never launches kernel {kernel}")
    return recorder.caught


def compulsory(kernel: str, launches: list[Arguments], shape: tuple[int, int, int]) -> tuple[int, str]:
    """Bytes that a kernel cannot do without moving: each array that goes in and each that comes out, once.

    An output that is added to or raised, as the keys of the other view's winners are, goes in and comes out. What
    passes between launches that belong together does not count.

    Args:
        kernel: its name.
        launches: as caught.
        shape: height, width and disparities.

    Returns:
        The bytes, and the formula in W, H and D that they follow from.
    """
    inputs = {name: v for name, v in _arrays(launches[0]) if not name.endswith("_out")}
    outputs = {name: v for name, v in _arrays(launches[-1]) if name.endswith("_out")}
    arrays = [*inputs.values(), *outputs.values()]
    if kernel in ADDED_TO:
        arrays.append(outputs[ADDED_TO[kernel]])
    height, width, disparities = shape
    whole = pixel = rest = 0
    for array in arrays:
        elements = 1
        for side in array.shape:
            elements *= side
        size = elements * array.dtype.itemsize
        if elements % (width * height * disparities) == 0:
            whole += size // (width * height * disparities)
        elif elements % (width * height) == 0:
            pixel += size // (width * height)
        else:
            rest += size
    terms = [(whole, f"{whole} WHD"), (pixel, f"{pixel} WH"), (rest, f"{rest:,}")]
    formula = " + ".join(text for count, text in terms if count)
    return whole * width * height * disparities + pixel * width * height + rest, formula


def _arrays(arguments: Arguments) -> list[tuple[str, DeviceArray]]:
    return [(name, value) for name, value in arguments.items() if isinstance(value, DeviceArray)]
