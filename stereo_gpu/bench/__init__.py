"""Time every kernel and profile beside OpenCV's functions, keep, compare and draw the runs."""

from stereo_gpu.bench.run import SIZES, BenchOptions, check_bench_options, run_bench

__all__ = ["SIZES", "BenchOptions", "check_bench_options", "run_bench"]
