"""The compute: one folder a language, the same file, kernel and parameter names in both.

Where a CPU and a GPU want different loops, NAME_cpu holds a second form of the kernel NAME, with the same name,
parameters and answer. The device's kind chooses.
"""
