#!/usr/bin/env python3
"""Bundle adjustments side by side: Ceres (pycolmap, SPARSE_SCHUR), a numpy reference for the covariance of all points of a free
network, and this program, on the same networks from the same starts, in turn.

usage: bundle_peers.py PEERS OUR_BENCH [REPEATS] [NET ...]
  PEERS      folder with make_network.py, ba_pycolmap.py, ba_cov_numpy.py
  OUR_BENCH  the program that `cargo bench --bench bundle --no-run` builds
  NET        box1, box10, box100 (default box1 box10)
Networks and results go to PEERS_OUT, else to tiepoint-peers in the temporary folder. Prints the medians and their ratios."""
import json
import os
import statistics
import subprocess
import sys
import tempfile

peers, ours = sys.argv[1], os.path.abspath(sys.argv[2])
repeats = int(sys.argv[3]) if len(sys.argv) > 3 else 5
nets = sys.argv[4:] or ["box1", "box10"]
out = os.environ.setdefault("PEERS_OUT", os.path.join(tempfile.gettempdir(), "tiepoint-peers"))
os.environ["GAUGE"] = "UNSPECIFIED"


def last_line(command, **settings):
    done = subprocess.run(command, capture_output=True, text=True, **settings)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: ended with {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def of_peer(script, *words):
    return last_line([sys.executable, script, *words], cwd=peers)


print("| network | Ceres, s | Tiepoint, s | ratio | sigma0 px, both | ten parameters, s | sigma0 px | numpy covariances, s | Tiepoint's statistics, s | ratio | mean sigma mm, both |")
print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
for net in nets:
    folder = os.path.join(out, "net", net)
    if not os.path.isdir(folder):
        subprocess.run([sys.executable, "make_network.py", net], cwd=peers, check=True)
    runs = []
    for _ in range(repeats):
        ceres = of_peer("ba_pycolmap.py", net, "sparse", "2")
        numpy = of_peer("ba_cov_numpy.py", net, "2")
        runs.append((ceres, numpy, last_line([ours, folder, "2"]), last_line([ours, folder, "2", "brown"])))
    median = lambda of: statistics.median(of(run) for run in runs)
    ceres, own = median(lambda r: r[0]["solve_s"]), median(lambda r: r[2]["solve_s"])
    numpy, statistic = median(lambda r: r[1]["total_s"]), median(lambda r: r[2]["statistics_s"])
    brown = median(lambda r: r[3]["solve_s"])
    first = runs[0]
    print(
        f"| {net} | {ceres:.4f} | {own:.4f} | {own / ceres:.2f} | {first[0]['sigma0_px']:.6f} / {first[2]['sigma0_px']:.6f} | {brown:.4f} | {first[3]['sigma0_px']:.6f} "
        f"| {numpy:.4f} | {statistic:.4f} | {statistic / numpy:.2f} | {first[1]['mean_sd_mm']:.5f} / {first[2]['mean_sd_mm']:.5f} |"
    )
