"""What Oclgrind 21.10, a simulator that checks every access to memory, needs to run the kernels and to judge them.

- Its check for uninitialised values knows no `freeze`, which its optimiser makes: kernels stay as they are written.
- It has no count of trailing zeros, and does not know what clang notes of a function that it put in line.
- In a shuffle it takes every lane of index 11 for undefined: it compares the index with LLVM's number for the kind
  of an undefined value. The lanes are taken one by one instead.
- It does not see that a fill of a buffer initialises it: zeros are copied.
- It takes what it knew of a buffer for true of the next one at that address: buffers are never given back.
- pyopencl keeps its programs without the source, whose lines a report should show: they are built anew.
"""

from __future__ import annotations

import pyopencl as cl

BUILD_OPTIONS = ["-cl-opt-disable"]

# Put before a kernel's source. A macro is not expanded within itself, so that the type of a shuffle can be asked for.
PRELUDE = """
#define always_inline unused
#define __builtin_ctz(value) (31 - clz((value) & -(value)))
#define __builtin_shufflevector(first, second, ...)                                  \\
    ({                                                                               \\
        __typeof__((first) + (first)) first_ = (first), second_ = (second);          \\
        __typeof__(__builtin_shufflevector(first_, second_, __VA_ARGS__)) picked_;   \\
        const int places_[] = {__VA_ARGS__};                                         \\
        const int lanes_ = sizeof(first_) / sizeof(first_[0]);                       \\
        for (int k_ = 0; k_ < (int)(sizeof(places_) / sizeof(int)); k_++) {          \\
            int at_ = places_[k_];                                                   \\
            picked_[k_] = at_ < lanes_ ? first_[at_] : second_[at_ - lanes_];        \\
        }                                                                            \\
        picked_;                                                                     \\
    })
"""


def is_oclgrind(device: cl.Device) -> bool:
    """Whether a device is Oclgrind's."""
    return bool(device.platform.name == "Oclgrind")
