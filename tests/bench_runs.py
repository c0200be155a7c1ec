"""Runs of the benchmark made up for tests: known times, no clock."""

from stereo_gpu.bench.machine import DeviceFacts
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.row import OPENCV, Row
from stereo_gpu.bench.timing import Times

SIZES = ((640, 480, 64), (1280, 960, 128))
STEREOBM_SECONDS = 0.01


def times(median, repeats=10):
    return Times(median=median, lowest=0.9 * median, highest=1.2 * median, repeats=repeats)


def row(name, seconds, *, kind="kernel", device="opencl:one", size=SIZES[0], stereobm=STEREOBM_SECONDS, **more):
    pixels = size[0] * size[1]
    return Row(
        name=name,
        kind=kind,
        device=device,
        width=size[0],
        height=size[1],
        disparities=size[2],
        window=11,
        wall=times(seconds),
        on_device=None if kind == "peer" else times(0.8 * seconds),
        bytes_moved=42 * pixels,
        formula="42 WH",
        stereobm_wall=times(stereobm),
        **more,
    )


def facts(name="opencl:one", kind="cpu"):
    return DeviceFacts(
        name=name,
        device="a device",
        driver="driver 1.2",
        compiler="compiler 3.4",
        kind=kind,
        copy_bytes_s=50e9,
        operations_s=200e9,
        roofs="made up",
    )


def made_up_run(slowdown=1.0, machine="a processor", stereobm=STEREOBM_SECONDS, devices=("opencl:one", "warp:cpu")):
    rows = []
    for scale, size in zip((1, 8), SIZES, strict=True):
        pixels, cells = size[0] * size[1], size[0] * size[1] * size[2]
        bm = scale * stereobm
        rows += [
            row("StereoBM", bm, kind="peer", device=OPENCV, size=size, per="cell", stereobm=bm),
            row("SGBM HH", 6 * bm, kind="peer", device=OPENCV, size=size, per="cell", stereobm=bm),
        ]
        for index, device in enumerate(devices):
            slow = (1 + 9 * index) * scale * slowdown
            rows += [
                row(
                    "ncc_wta",
                    0.004 * slow,
                    device=device,
                    size=size,
                    per="cell",
                    operations=11.0 * cells,
                    peer="StereoBM",
                    peer_wall=times(bm),
                    stereobm=bm,
                ),
                row("grey", 0.0005 * slow, device=device, size=size, operations=9.0 * pixels, stereobm=bm),
                row(
                    "match fast",
                    0.009 * slow,
                    kind="profile",
                    device=device,
                    size=size,
                    per="cell",
                    transfer=0.001,
                    peer="StereoBM+check+median",
                    peer_wall=times(1.2 * bm),
                    stereobm=bm,
                ),
            ]
    rows.append(
        Row(
            name="match precise",
            kind="profile",
            device=devices[0],
            width=640,
            height=480,
            disparities=64,
            window=11,
            per="cell",
            peer="SGBM HH",
            note="not run: needs 9 bytes <here>",
        )
    )
    return BenchRun(
        started="2026-01-02T03:04:05+00:00",
        took=12.5,
        method={
            "seconds": 5.0,
            "warm_up_seconds": 1.0,
            "repeats": 10,
            "fewest_repeats": 3,
            "dropped_at_either_end": 0.05,
            "cap_seconds": 60.0,
            "stereobm_share": 0.2,
        },
        machine={
            "processor": machine,
            "cores": 2,
            "memory_bytes": 8 << 30,
            "system": "Linux 6.1 x86_64",
            "python": "3.11.2",
            "opencv": "5.0.0, 2 threads",
            "load_average": 0.1,
            "versions": {"numpy": "2.0"},
        },
        peers={"StereoBM": "numDisparities=D, blockSize=11"},
        devices=tuple(facts(name) for name in devices),
        rows=tuple(rows),
    )
