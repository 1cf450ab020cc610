"""The module from the angles between neighbouring beams, by scipy, on the problem of benches/angles.rs.

    pip install numpy scipy
    python benches/peers/angles.py

Prints a Markdown table: fastest of the repetitions, and the position found. Table 6.1: 11 x 11 beams
at equal angles of 2.9 degrees, a plane at 2 m, dots uncertain by 0.1 mm, all 420 neighbour angles,
unit weights, from a start 60 mm off. The noise is numpy's, so positions differ from the Rust
benchmark's by a standard deviation or so; the two rows agree with each other.
"""

import time

import numpy as np
from scipy.optimize import least_squares, minimize

SIZE, STEP, START = 11, np.radians(2.9), np.array([30.0, -30.0, 40.0])


def beams():
    """Unit directions, row by row: a net of equal rhombi on the sphere."""
    half = SIZE // 2
    quadrant = np.zeros((half + 1, half + 1, 3))
    for k in range(half + 1):
        quadrant[0, k] = np.sin(k * STEP), 0.0, np.cos(k * STEP)
        quadrant[k, 0] = 0.0, np.sin(k * STEP), np.cos(k * STEP)
    for row in range(1, half + 1):
        for column in range(1, half + 1):
            middle = quadrant[row - 1, column] + quadrant[row, column - 1]
            middle /= np.linalg.norm(middle)
            near = quadrant[row - 1, column - 1]
            quadrant[row, column] = 2.0 * middle * (middle @ near) - near
    orders = range(-half, half + 1)
    return np.array([quadrant[abs(n), abs(m)] * (np.sign(m) or 1, np.sign(n) or 1, 1)
                     for n in orders for m in orders])


def pairs():
    index = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
    ends = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:]),
            (index[:-1, :-1], index[1:, 1:]), (index[1:, :-1], index[:-1, 1:])]
    return tuple(np.concatenate([e[k].ravel() for e in ends]) for k in (0, 1))


def angles_between(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))


def fastest(solve, repetitions):
    times = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        found = solve()
        times.append(time.perf_counter() - begin)
    return min(times), found


def main():
    directions, (a, b) = beams(), pairs()
    reference = angles_between(directions[a], directions[b])
    rng = np.random.default_rng(1)
    dots = directions * (2000.0 / directions[:, 2:]) + rng.normal(0.0, 0.1, directions.shape)

    def residuals(at):
        arms = dots - at
        return angles_between(arms[a], arms[b]) - reference

    def cost(at):
        r = residuals(at)
        return r @ r

    simplex = {"xatol": 1e-3, "fatol": 1e-15, "maxiter": 5000, "maxfev": 5000}
    rows = [
        ("scipy Levenberg-Marquardt (MINPACK)", 200,
         lambda: least_squares(residuals, START, method="lm").x),
        ("scipy Nelder-Mead", 30,
         lambda: minimize(cost, START, method="Nelder-Mead", options=simplex).x),
    ]
    print("| solver | fastest | position, mm |\n|---|---|---|")
    for name, repetitions, solve in rows:
        seconds, found = fastest(solve, repetitions)
        place = " ".join(f"{c:.4f}" for c in found)
        print(f"| {name} | {1e3 * seconds:.2f} ms | {place} |")


main()
