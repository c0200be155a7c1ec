"""The chain that a user would write with OpenCV and trimesh: a raw pair and its calibration to a textured GLB.

A plain script, as short as such scripts are. `bench_chain.py` times it against ours.
"""

import sys
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import trimesh

SMALLEST, DISPARITIES, TRIANGLES, LARGEST_JUMP = 40, 64, 20_000, 3.0


def rectification(calibration):
    """Maps and Q of cv2.stereoRectify, from OpenCV's own file of a calibration."""
    stored = cv2.FileStorage(str(calibration), cv2.FILE_STORAGE_READ)
    K1, D1, K2, D2, R, T = (stored.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T"))
    size = tuple(int(side) for side in stored.getNode("size").mat().ravel())
    R1, R2, P1, P2, Q = cv2.stereoRectify(K1, D1, K2, D2, size, R, T, alpha=-1)[:5]
    left = cv2.initUndistortRectifyMap(K1, D1, R1, P1, size, cv2.CV_16SC2)
    right = cv2.initUndistortRectifyMap(K2, D2, R2, P2, size, cv2.CV_16SC2)
    return left, right, P1, Q


def reconstruct(left_file, right_file, out, maps_left, maps_right, P1, Q):
    """One pair: rectify, match, reproject, mesh, decimate, texture with the left picture, write."""
    left = cv2.remap(cv2.imread(str(left_file)), *maps_left, cv2.INTER_LINEAR)
    right = cv2.remap(cv2.imread(str(right_file)), *maps_right, cv2.INTER_LINEAR)
    matcher = cv2.StereoSGBM.create(
        minDisparity=SMALLEST,
        numDisparities=DISPARITIES,
        blockSize=5,
        P1=8 * 3 * 25,
        P2=32 * 3 * 25,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    disparity = matcher.compute(left, right).astype(np.float32) / 16
    points = cv2.reprojectImageTo3D(disparity, Q)

    height, width = disparity.shape
    number = np.arange(height * width).reshape(height, width)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    flat = disparity.ravel()
    corners = np.stack([flat[a], flat[b], flat[c], flat[d]])
    good = (corners >= SMALLEST).all(axis=0) & (np.ptp(corners, axis=0) < LARGEST_JUMP)
    faces = np.concatenate([np.column_stack([a, b, c])[good], np.column_stack([a, c, d])[good]])

    mesh = trimesh.Trimesh(points.reshape(-1, 3), faces, process=False)
    mesh.remove_unreferenced_vertices()
    mesh = mesh.simplify_quadric_decimation(face_count=TRIANGLES)
    seen = mesh.vertices @ P1[:, :3].T
    uv = seen[:, :2] / seen[:, 2:] / (width, height)
    uv[:, 1] = 1 - uv[:, 1]
    picture = trimesh.visual.texture.SimpleMaterial(image=_pillow(left))
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=picture)
    mesh.export(out)
    return len(mesh.faces)


def _pillow(bgr):
    from PIL import Image

    return Image.fromarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))


def main(folder, calibration, out, processes):
    """All pairs of a folder, in this process or in a pool of several."""
    ready = rectification(calibration)
    lefts = sorted(Path(folder).glob("left*.png"))
    rights = sorted(Path(folder).glob("right*.png"))
    jobs = [(left, right, Path(out) / f"{left.stem}.glb", *ready) for left, right in zip(lefts, rights, strict=True)]
    if processes == 1:
        counts = [reconstruct(*job) for job in jobs]
    else:
        # OpenCV's threads do not live on in a fork: the processes would wait for them for ever.
        with get_context("spawn").Pool(processes, cv2.setNumThreads, (1,)) as pool:
            counts = pool.starmap(reconstruct, jobs, chunksize=1)
    print(int(np.median(counts)))


if __name__ == "__main__":
    main(*sys.argv[1:4], int(sys.argv[4]))
