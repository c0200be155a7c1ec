"""What Oclgrind 21.10, a simulator that checks every access to memory, needs to run the kernels and to judge them.

- Its check for uninitialised values knows no `freeze`, which its optimiser makes: kernels stay as they are written.
- It has no count of trailing zeros.
- In a shuffle it takes every lane of index 11 for undefined: it compares the index with LLVM's number for the kind
  of an undefined value. The lanes are taken one by one instead.
- It does not see that a fill of a buffer initialises it: zeros are copied.
- pyopencl keeps its programs without the source, whose lines a report should show: they are built anew.
"""

from __future__ import annotations

import pyopencl as cl

BUILD_OPTIONS = ["-cl-opt-disable"]

# Put before a kernel's source. A macro is not expanded within itself, so that the type of a shuffle can be asked for.
PRELUDE = """
#define __builtin_ctz(value) (31 - clz((value) & -(value)))
#define __builtin_shufflevector(first, second, ...)                                   \\
    ({                                                                                \\
        __typeof__(first) first_ = (first), second_ = (second);                       \\
        __typeof__(__builtin_shufflevector(first_, second_, __VA_ARGS__)) picked_;    \\
        const int places_[] = {__VA_ARGS__}, length_ = sizeof(first_) / sizeof(first_[0]); \\
        for (int k_ = 0; k_ < (int)(sizeof(places_) / sizeof(int)); k_++) {           \\
            int place_ = places_[k_];                                                 \\
            picked_[k_] = place_ < length_ ? first_[place_] : second_[place_ - length_]; \\
        }                                                                             \\
        picked_;                                                                      \\
    })
"""


def is_oclgrind(device: cl.Device) -> bool:
    """Whether a device is Oclgrind's."""
    return bool(device.platform.name == "Oclgrind")
