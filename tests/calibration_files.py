"""A rig with awkward digits, and calibration files as other programs write them, for tests."""

import math

import cv2
import numpy as np

from stereo_gpu.deviations import CameraDeviations, Deviations
from stereo_gpu.rig import Camera, Rig

MIDDLEBURY = """cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
doffs=131.111
baseline=193.001
width=2964
height=1988
ndisp=280
isint=0
vmin=31
vmax=257
dyavg=0.918
dymax=1.516
"""

KITTI_ODOMETRY = """P0: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 0.000000000000e+00 0.000000000000e+00 \
7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 \
0.000000000000e+00
P1: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 -3.861448000000e+02 0.000000000000e+00 7.188560000000e+02 \
1.852157000000e+02 0.000000000000e+00 0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 0.000000000000e+00
P2: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 4.538225000000e+01 0.000000000000e+00 7.188560000000e+02 \
1.852157000000e+02 -1.130887000000e-01 0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 3.779761000000e-03
P3: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 -3.372877000000e+02 0.000000000000e+00 7.188560000000e+02 \
1.852157000000e+02 2.369057000000e+00 0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 4.915215000000e-03
"""

KITTI_RAW = """calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 9.842439e+02 0.000000e+00 6.900000e+02 0.000000e+00 9.808141e+02 2.331966e+02 0.000000e+00 0.000000e+00 \
1.000000e+00
D_00: -3.728755e-01 2.037299e-01 2.219027e-03 1.383707e-03 -7.233722e-02
R_00: 1.000000e+00 0.000000e+00 0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00 0.000000e+00 0.000000e+00 \
1.000000e+00
T_00: 2.573699e-16 -1.059758e-16 1.614870e-16
S_rect_00: 1.242000e+03 3.750000e+02
R_rect_00: 9.999239e-01 9.837760e-03 -7.445048e-03 -9.869795e-03 9.999421e-01 -4.278459e-03 7.402527e-03 4.351614e-03 \
9.999631e-01
P_rect_00: 7.215377e+02 0.000000e+00 6.095593e+02 0.000000e+00 0.000000e+00 7.215377e+02 1.728540e+02 0.000000e+00 \
0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00
S_01: 1.392000e+03 5.120000e+02
K_01: 9.895267e+02 0.000000e+00 7.020000e+02 0.000000e+00 9.878386e+02 2.455590e+02 0.000000e+00 0.000000e+00 \
1.000000e+00
D_01: -3.644661e-01 1.790019e-01 1.148107e-03 -6.298563e-04 -5.314062e-02
R_01: 9.993513e-01 1.860866e-02 -3.083487e-02 -1.887662e-02 9.997863e-01 -8.421873e-03 3.067156e-02 8.998467e-03 \
9.994890e-01
T_01: -5.370000e-01 4.822061e-03 -1.252488e-02
S_rect_01: 1.242000e+03 3.750000e+02
R_rect_01: 9.996878e-01 -8.976826e-03 2.331651e-02 8.876121e-03 9.999508e-01 4.418952e-03 -2.335503e-02 -4.210612e-03 \
9.997184e-01
P_rect_01: 7.215377e+02 0.000000e+00 6.095593e+02 -3.875744e+02 0.000000e+00 7.215377e+02 1.728540e+02 0.000000e+00 \
0.000000e+00 0.000000e+00 1.000000e+00 0.000000e+00
"""


def make_rig(coefficients=5, size=(640, 480), deviations=False):
    """A rig whose numbers need all their digits, one of them very small, one a negative zero."""
    random = np.random.default_rng(coefficients)
    matrix = np.array([[1600 / 3, 0, 321.1], [0, 3700 / 7, 239.7], [0, 0, 1]])
    lens = random.normal(size=coefficients) / 3
    lens[3] = -0.0
    return Rig(
        left=Camera(matrix, lens, size, 0.1),
        right=Camera(matrix + np.diag([math.pi, math.e, 0]), lens / 3, size, 0.2),
        R=cv2.Rodrigues(np.array([0.01, -0.02, 1 / 300]))[0],
        T=np.array([-100 / 3, 1e-17, 0.1 + 0.2]),
        rms_px=1 / 7,
        epipolar_rms_px=1 / 9,
        deviations=_deviations(random) if deviations else None,
    )


def _deviations(random):
    left, right = (
        CameraDeviations(fx=fx, fy=fy, cx=cx, cy=cy, distortion=random.random(5))
        for fx, fy, cx, cy in random.random((2, 4))
    )
    return Deviations(left=left, right=right, om=random.random(3), T=random.random(3))


def same(one, other):
    """Whether both rigs have the same cameras, R, T and unit, to the bit."""
    arrays = [
        (getattr(camera, name), getattr(twin, name))
        for camera, twin in ((one.left, other.left), (one.right, other.right))
        for name in ("matrix", "distortion")
    ]
    arrays += [(one.R, other.R), (one.T, other.T)]
    sizes = (one.left.size, one.right.size, one.unit) == (other.left.size, other.right.size, other.unit)
    return sizes and all(a.tobytes() == b.tobytes() for a, b in arrays)
