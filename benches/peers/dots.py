#!/usr/bin/env python3
"""Centres of speckled dots by other programs' methods, on the pictures that the project's own
example writes:

    cargo run --release -p beampose-photogrammetry --example speckle -- FOLDER > own.md
    python3 benches/peers/dots.py FOLDER [own.md]        # needs opencv-python-headless and numpy

Prints a Markdown table: for each contrast and grain the rms error of a coordinate in pixels and the
dots found of 121. A dot counts as found within 3 pixels of its place, and only found ones have an
error, which favours methods that lose the difficult ones. The two window methods are told the true
place to the nearest pixel, which favours them as well.
"""

import collections
import csv
import glob
import os
import re
import sys

import cv2
import numpy as np

NEAR_PX = 3.0


def blob_detector(image, _truth):
    """OpenCV's SimpleBlobDetector for light blobs, its convexity filter off."""
    options = cv2.SimpleBlobDetector_Params()
    options.filterByColor, options.blobColor = True, 255
    options.filterByConvexity = options.filterByInertia = options.filterByCircularity = False
    options.filterByArea, options.minArea, options.maxArea = True, 8, 2000
    options.minDistBetweenBlobs = 8
    return np.array([k.pt for k in cv2.SimpleBlobDetector_create(options).detect(image)])


def connected_components(image, _truth):
    """Threshold at a quarter of the peak, grey-weighted centroid of each component."""
    _, binary = cv2.threshold(image, 68, 255, cv2.THRESH_BINARY)
    binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(binary)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    weight = np.clip(image.astype(float) - 30, 0, None)
    sums = [np.bincount(labels.ravel(), w.ravel(), count) for w in (weight, weight * x, weight * y)]
    used = [i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= 8]
    return np.array([[sums[1][i] / sums[0][i], sums[2][i] / sums[0][i]] for i in used])


def window(image, at, half=12):
    column, row = np.rint(at).astype(int)
    rows = np.arange(max(row - half, 0), min(row + half + 1, image.shape[0]))
    columns = np.arange(max(column - half, 0), min(column + half + 1, image.shape[1]))
    return np.meshgrid(columns, rows), image[np.ix_(rows, columns)].astype(float)


def gaussian_window(image, truth):
    """Centroid under a Gaussian window that moves with it (a matched filter's maximum)."""
    found = []
    for place in truth:
        (x, y), grey = window(image, place)
        light, at = grey - 30, np.rint(place).astype(float)
        for _ in range(50):
            weight = light * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * 3.0**2))
            at = at + 2 * (np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum() - at)
        found.append(at)
    return np.array(found)


def least_squares_match(image, truth):
    """A template of the true size: place, gain and offset, all pixels alike."""
    found = []
    for place in truth:
        (x, y), grey = window(image, place)
        at, gain, offset = np.rint(place).astype(float), 150.0, 30.0
        for _ in range(20):
            u, v = x - at[0], y - at[1]
            f = np.exp(-(u**2 + v**2) / 18.0)
            columns = [gain * f * u / 9.0, gain * f * v / 9.0, f, np.ones_like(f)]
            matrix = np.stack([c.ravel() for c in columns], axis=1)
            step = np.linalg.lstsq(matrix, (grey - offset - gain * f).ravel(), rcond=None)[0]
            at, gain, offset = at + np.clip(step[:2], -2, 2), gain + step[2], offset + step[3]
        found.append(at)
    return np.array(found)


PEERS = {
    "OpenCV blob": blob_detector,
    "components": connected_components,
    "Gaussian window": gaussian_window,
    "least-squares match": least_squares_match,
}


def errors(found, truth):
    """Errors of the places that were found."""
    if len(found) == 0:
        return np.empty((0, 2))
    offsets = found[None, :, :] - truth[:, None, :]
    distances = np.linalg.norm(offsets, axis=2)
    nearest = distances.argmin(axis=1)
    here = np.arange(len(truth))
    return offsets[here, nearest][distances[here, nearest] < NEAR_PX]


def own_figures(path):
    """Cells of the table that the example printed: found and rms as text."""
    cells = {}
    with open(path, encoding="utf-8") as table:
        for line in table:
            words = [word.strip() for word in line.strip().strip("|").split("|")]
            if re.match(r"[0-9.]+$", words[0]):
                cells[tuple(map(float, words[:2]))] = f"{words[3]} ({words[2]})"
    return cells


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    folder = sys.argv[1]
    own = own_figures(sys.argv[2]) if len(sys.argv) > 2 else {}
    cells = collections.defaultdict(list)
    for path in sorted(glob.glob(os.path.join(folder, "c*_g*_*.png"))):
        match = re.match(r"c([0-9.]+)_g([0-9.]+)_", os.path.basename(path))
        cells[float(match[1]), float(match[2])].append(path)
    names = (["beampose"] if own else []) + list(PEERS)
    print("rms px (found of 121)\n")
    print("| contrast | grain px | " + " | ".join(names) + " |")
    print("|---" * (len(names) + 2) + "|")
    for cell, paths in sorted(cells.items()):
        row = [own.get(cell, "")] if own else []
        for peer in PEERS.values():
            all_errors = []
            for path in paths:
                with open(path[:-4] + ".csv", encoding="utf-8") as lines:
                    truth = np.array([[float(v) for v in line] for line in csv.reader(lines)])
                image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
                all_errors.append(errors(peer(image, truth), truth))
            stacked = np.concatenate(all_errors)
            rms = np.sqrt((stacked**2).mean()) if len(stacked) else float("nan")
            row.append(f"{rms:.4f} ({len(stacked) / len(paths):.0f})")
        print(f"| {cell[0]} | {cell[1]} | " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
