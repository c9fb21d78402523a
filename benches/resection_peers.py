#!/usr/bin/env python3
"""Our resection and other programs' on the same trials, one thread, nobody gets an initial value.

usage: resection_peers.py TRIALS [BENCH]     (needs numpy, opencv and poselib from PyPI)

Writes the trials to the file TRIALS, runs ours on them (`cargo bench --bench resection`, or the program BENCH), then the
others, and prints one table: failures in per cent (station off by more than 20 mm; of three points the best of the
solutions counts, of more points the first) and the median time of a call, for the others from Python."""
import os
import subprocess
import sys
import time

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
import cv2
import numpy as np
import poselib

TRIALS = 1500
COUNTS = range(3, 9)
NOISE_PX = 0.04
FAILED_MM = 20.0
SIZE = np.array([3072.0, 2048.0])
FOCAL_PX = 2222.0
CAMERA = np.array([[FOCAL_PX, 0, SIZE[0] / 2], [0, FOCAL_PX, SIZE[1] / 2], [0, 0, 1]])
FLAGS = {
    "P3P": cv2.SOLVEPNP_P3P,
    "AP3P": cv2.SOLVEPNP_AP3P,
    "EPnP": cv2.SOLVEPNP_EPNP,
    "SQPnP": cv2.SOLVEPNP_SQPNP,
    "IPPE": cv2.SOLVEPNP_IPPE,
    "iterative": cv2.SOLVEPNP_ITERATIVE,
}


def trial(random, count, flat):
    """Points of a box of 600 x 400 x 300 mm (flat: 600 x 400 mm), about 1 m before a camera in any attitude, none nearly
    in a line: object points (mm), noisy image points (px), and the true station."""
    while True:
        points = random.uniform(-1, 1, (count, 3)) * [300, 200, 0 if flat else 150]
        axis = random.normal(size=3)
        rotation = cv2.Rodrigues(axis / np.linalg.norm(axis) * random.uniform(0, np.pi))[0]
        if flat and abs(rotation[2, 2]) < 0.35:
            continue
        shift = np.array([random.uniform(*range_mm) for range_mm in ((-100, 100), (-60, 60), (900, 1300))])
        seen = points @ rotation.T + shift
        image = seen[:, :2] / seen[:, 2:] * FOCAL_PX + SIZE / 2
        inside = ((image > 0) & (image < SIZE)).all()
        if inside and np.linalg.svd(points - points.mean(0))[1][1] >= 80:
            return points, image + random.normal(0, NOISE_PX, image.shape), -rotation.T @ shift


def write(path, groups):
    """A line a point: group, trial, object point, image point, true station."""
    with open(path, "w") as file:
        file.write("shape,count,trial,x_mm,y_mm,z_mm,x_px,y_px,station_x_mm,station_y_mm,station_z_mm\n")
        for (shape, count), trials in groups.items():
            for number, (points, image, station) in enumerate(trials):
                for point, pixel in zip(points, image):
                    numbers = ",".join(f"{x:.17g}" for x in (*point, *pixel, *station))
                    file.write(f"{shape},{count},{number},{numbers}\n")


def with_opencv(flag, count):
    solve = cv2.solveP3P if count == 3 and flag in (cv2.SOLVEPNP_P3P, cv2.SOLVEPNP_AP3P) else cv2.solvePnPGeneric

    def resect(points, image):
        arguments = points.reshape(-1, 1, 3), image.reshape(-1, 1, 2)
        begun = time.perf_counter()
        try:
            found, turns, shifts = solve(*arguments, CAMERA, None, flags=flag)[:3]
        except cv2.error:
            return [], None
        spent = time.perf_counter() - begun
        return [-cv2.Rodrigues(turn)[0].T @ shift.ravel() for turn, shift in zip(turns, shifts)] if found else [], spent

    return resect


def with_poselib(points, image):
    rays = np.c_[(image - SIZE / 2) / FOCAL_PX, np.ones(len(image))]
    rays = list(rays / np.linalg.norm(rays, axis=1)[:, None])
    points = list(points)
    begun = time.perf_counter()
    found = poselib.p3p(rays, points)
    spent = time.perf_counter() - begun
    return [-np.array(pose.R).T @ np.array(pose.t) for pose in found], spent


def peers(shape, count):
    for name, flag in FLAGS.items():
        if (count <= 4 or "P3P" not in name) and (shape == "flat" or name != "IPPE"):
            yield f"OpenCV {name}", with_opencv(flag, count)
    if count == 3:
        yield "PoseLib P3P", with_poselib


def measured(resect, trials):
    """Failures in per cent and the median time of a call in us; nothing where the method refuses all trials."""
    failures, times = 0, []
    for points, image, station in trials:
        found, spent = resect(points, image)
        counted = found if len(points) == 3 else found[:1]
        failures += all(np.linalg.norm(centre - station) > FAILED_MM for centre in counted)
        times += [spent] if spent is not None else []
    return (100 * failures / len(trials), 1e6 * float(np.median(times))) if times else None


def ours(path, bench):
    """What our program says: shape, name, number of points, failures in per cent, us."""
    said = subprocess.run([*bench, path], check=True, stdout=subprocess.PIPE, text=True).stdout
    for line in said.splitlines():
        shape, count, method, failed, of, us = line.split(",")
        yield shape, f"Tiepoint, {method}", int(count), (100 * int(failed) / int(of), float(us))


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    path = os.path.abspath(sys.argv[1])
    cv2.setNumThreads(1)
    random = np.random.default_rng(5)
    groups = {
        (shape, count): [trial(random, count, shape == "flat") for _ in range(TRIALS)]
        for shape in ("general", "flat")
        for count in COUNTS
    }
    write(path, groups)
    cargo = ["cargo", "bench", "--manifest-path", os.path.join(os.path.dirname(__file__), "..", "Cargo.toml")]
    bench = [os.path.abspath(sys.argv[2])] if len(sys.argv) == 3 else [*cargo, "--bench", "resection", "--"]
    table = {}
    for shape, name, count, cell in ours(path, bench):
        table.setdefault((shape, name), {})[count] = cell
    for (shape, count), trials in groups.items():
        for name, resect in peers(shape, count):
            table.setdefault((shape, name), {})[count] = measured(resect, trials)
    print("| points, method | " + " | ".join(f"n = {count}" for count in COUNTS) + " |")
    print("| --- " * (len(COUNTS) + 1) + "|")
    for (shape, name), row in sorted(table.items(), key=lambda item: item[0][0], reverse=True):
        cells = [row.get(count) for count in COUNTS]
        told = [f"{cell[0]:.2f} %, {cell[1]:.0f} us" if cell else "-" for cell in cells]
        print(f"| {shape}, {name} | " + " | ".join(told) + " |")


if __name__ == "__main__":
    main()
