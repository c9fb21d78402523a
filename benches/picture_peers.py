#!/usr/bin/env python3
"""Ours and other programs on the same picture with known centres, in one run, on one thread.

usage: picture_peers.py PICTURE CENTRES     (needs numpy, opencv and sep from PyPI; CENTRES: x y ... a dot a line, first
pixel's centre at 0, 0). Prints milliseconds, dots found, false ones, rms of the centres, and the ratios to ours."""
import os
import re
import subprocess
import sys
import time

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
import cv2
import numpy as np
import sep

RUNS = 15
SAME_PX = 3.0
# Between the ground and the faintest dots of the picture that the others are usually tried on.
THRESHOLD = 45


def contours(image):
    _, light = cv2.threshold(image, THRESHOLD, 255, cv2.THRESH_BINARY)
    outlines, _ = cv2.findContours(light, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [cv2.fitEllipse(outline)[0] for outline in outlines if len(outline) >= 8]


def weighted_centroids(image):
    _, light = cv2.threshold(image, THRESHOLD, 255, cv2.THRESH_BINARY)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(light, connectivity=8)
    inside = np.flatnonzero(labels)
    label, weight = labels.ravel()[inside], image.ravel()[inside].astype(float) - THRESHOLD
    row, column = np.divmod(inside, image.shape[1])
    total = np.bincount(label, weight, count)
    wanted = (stats[:, 4] >= 20) & (stats[:, 4] < 2000)
    wanted[0] = False
    x = np.bincount(label, weight * column, count)[wanted] / total[wanted]
    return np.c_[x, np.bincount(label, weight * row, count)[wanted] / total[wanted]]


def windowed_positions(image):
    data = image.astype(np.float32)
    data = data - sep.Background(data)
    found = sep.extract(data, 20.0, err=1.0, minarea=20, deblend_cont=1.0, filter_kernel=None)
    width = 2 / 2.35 * np.sqrt(found["a"] * found["b"]) * 1.6
    x, y, _ = sep.winpos(data, found["x"], found["y"], width)
    return np.c_[x, y]


def score(found, truth):
    found = np.asarray(found, float).reshape(-1, 2)
    apart = np.linalg.norm(found[:, None] - truth[None], axis=2)
    errors = [found[apart[:, dot].argmin()] - truth[dot] for dot in range(len(truth)) if apart[:, dot].min() < SAME_PX]
    return len(errors), len(found) - len(errors), float(np.sqrt((np.array(errors) ** 2).mean()))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    picture, centres = map(os.path.abspath, sys.argv[1:])
    image, truth = cv2.imread(picture, cv2.IMREAD_GRAYSCALE), np.loadtxt(centres)[:, :2]
    cv2.setNumThreads(1)
    here = os.path.dirname(os.path.abspath(__file__))
    bench = ["cargo", "bench", "--bench", "picture", "--", picture, centres]
    said = subprocess.run(bench, cwd=here, check=True, capture_output=True, text=True).stdout
    ours = re.search(r"([\d.]+) ms .*?; (\d+) of \d+ found, (\d+) others; rms ([\d.]+) px", said)
    ours_ms, ours_rms = float(ours[1]), float(ours[4])
    print(f"{'Tiepoint':32} {ours_ms:8.1f} ms  {ours[2]:>4} found {ours[3]:>3} false  {ours_rms:.4f} px")
    for name, locate in (
        ("OpenCV contours, ellipses", contours),
        ("OpenCV components, grey weights", weighted_centroids),
        ("SEP windowed positions", windowed_positions),
    ):
        result, times = locate(image), []
        for _ in range(RUNS):
            begun = time.perf_counter()
            locate(image)
            times.append((time.perf_counter() - begun) * 1e3)
        ms = float(np.median(times))
        found, false, rms = score(result, truth)
        print(
            f"{name:32} {ms:8.1f} ms  {found:>4} found {false:>3} false  {rms:.4f} px   "
            f"{ms / ours_ms:.2f} times our time, {rms / ours_rms:.2f} times our error"
        )


if __name__ == "__main__":
    main()
