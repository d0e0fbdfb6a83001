#!/usr/bin/env python3
"""The gain library against cvxpy: the same matrix inequalities, another author's modelling and solvers.

Usage: cvxpy_gains.py FOLDER_OF_GAIN_FILES

For every proof in every file the least gamma is computed afresh. The file's own must not be smaller
than that (it would prove what is not true) nor more than 0.5 % larger.
"""

import sys
import tomllib
from pathlib import Path

import cvxpy as cp
import numpy as np

TOLERANCE = 5e-3
# Solvers stop within about this of the least gamma, on either side.
SOLVER_ERROR = 5e-4


def loops(gain, plants, followers):
    """x' = A x + Ad x(t - delay) + B w, z = C x for a platoon of equal trucks, one per (lag, plant gain)."""
    k1, k2 = np.array(gain["k1"]), np.array(gain["k2"])
    for lag, strength in plants:
        a1 = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / lag]])
        bu = np.array([[0], [0], [-strength / lag]])
        bw = np.array([[0, 0], [0, 0], [1 / lag, 1]])
        eye = np.eye(followers)
        k = np.kron(eye, k1[None, :]) + np.kron(np.eye(followers, k=-1), k2[None, :])
        c = np.kron(eye, [[1, 0, 0]])
        yield np.kron(eye, a1), np.kron(eye, bu) @ k, np.kron(eye, bw), c


def channel(gain, plants, from_forwarded, to_forwarded):
    """One truck, from w or from the forwarded signal, to its error or to what it forwards."""
    for (a, ad, b, c), (lag, strength) in zip(loops(gain, plants, 1), plants):
        if from_forwarded:
            b = np.array([[0], [0], [-strength / lag]])
        if to_forwarded:
            c = np.array([gain["k2"]])
        yield a, ad, b, c


def least_gamma(constraints, gamma2):
    """Minimises gamma², with the second solver where the first is not content."""
    problem = cp.Problem(cp.Minimize(gamma2), constraints)
    for solver in (cp.CLARABEL, cp.SCS):
        try:
            problem.solve(solver=solver)
        except cp.SolverError:
            continue
        if problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            return float(np.sqrt(gamma2.value))
    raise SystemExit(f"no solver found a gamma: {problem.status}")


def symmetric(matrix):
    return (matrix + matrix.T) / 2


def jensen(systems, h):
    """Theorem 1 with K fixed and Q = 0, by hand from Eq. 9: any rate of the delay."""
    systems = list(systems)
    n, m = systems[0][0].shape[0], systems[0][2].shape[1]
    p, z = cp.Variable((n, n), symmetric=True), cp.Variable((n, n), symmetric=True)
    gamma2 = cp.Variable()
    constraints = [p >> 1e-8 * np.eye(n), z >> 1e-8 * np.eye(n)]
    for a, ad, b, c in systems:
        e = np.hstack([a, ad, b])
        blocks = cp.bmat(
            [
                [p @ a + a.T @ p - z / h + c.T @ c, p @ ad + z / h, p @ b],
                [ad.T @ p + z / h, -z / h, np.zeros((n, m))],
                [b.T @ p, np.zeros((m, n)), -gamma2 * np.eye(m)],
            ]
        )
        constraints.append(symmetric(blocks + h * e.T @ z @ e) << 0)
    return least_gamma(constraints, gamma2)


def wirtinger(systems, h):
    """Seuret and Gouaisbaut's bound with the reciprocally convex combination, any rate."""
    systems = list(systems)
    n, m = systems[0][0].shape[0], systems[0][2].shape[1]
    p = cp.Variable((2 * n, 2 * n), symmetric=True)
    s, r = cp.Variable((n, n), symmetric=True), cp.Variable((n, n), symmetric=True)
    x, gamma2 = cp.Variable((2 * n, 2 * n)), cp.Variable()
    zero = np.zeros((n, n))
    twin = cp.bmat([[r, zero], [zero, 3 * r]])
    psi = cp.bmat([[twin, x], [x.T, twin]])
    constraints = [p >> 1e-8 * np.eye(2 * n), s >> 0, r >> 1e-8 * np.eye(n), psi >> 0]
    total = 5 * n + m
    e = [np.eye(total)[i * n : (i + 1) * n] for i in range(5)]
    w = np.eye(total)[5 * n :]
    ends = np.vstack([e[0] - e[1], e[0] + e[1] - 2 * e[3], e[1] - e[2], e[1] + e[2] - 2 * e[4]])
    for a, ad, b, c in systems:
        rate = a @ e[0] + ad @ e[1] + b @ w
        for delay in (0.0, h):
            zeta = np.vstack([e[0], delay * e[3] + (h - delay) * e[4]])
            zeta_rate = np.vstack([rate, e[0] - e[2]])
            half = zeta.T @ p @ zeta_rate
            form = half + half.T + e[0].T @ s @ e[0] - e[2].T @ s @ e[2]
            form += h * h * rate.T @ r @ rate - ends.T @ psi @ ends
            form += (c @ e[0]).T @ (c @ e[0]) - gamma2 * w.T @ w
            constraints.append(symmetric(form) << 0)
    return least_gamma(constraints, gamma2)


def proofs(file):
    """(what, gamma in the file, gamma computed here) for every proof."""
    gain, h = file["gain"], file["delay"]["longest_s"]
    plant = file["plant"]
    lags = {plant["lag_min_s"], plant["lag_max_s"]}
    strengths = {plant.get("gain_min", 1.0), plant.get("gain_max", 1.0)}
    plants = sorted((lag, strength) for lag in lags for strength in strengths)
    vehicle = file.get("vehicle", {})
    channels = {"disturbance_to_error": (vehicle, False, False)}
    for name, ends in (
        ("disturbance_to_forwarded", (False, True)),
        ("forwarded_to_error", (True, False)),
        ("forwarded_to_forwarded", (True, True)),
    ):
        channels[name] = (vehicle.get("coupling", {}), *ends)
    for name, (table, from_forwarded, to_forwarded) in channels.items():
        if name in table:
            systems = channel(gain, plants, from_forwarded, to_forwarded)
            yield name, table[name]["gamma"], wirtinger(systems, h)
    for platoon in file.get("platoon", []):
        n = platoon["followers"]
        if n > 1 and not any(gain["k2"]):
            continue  # The trucks are not coupled: the same numbers as for one, only slower.
        yield f"{n} followers", platoon["proof"]["gamma"], jensen(loops(gain, plants, n), h)


def main():
    bad = 0
    files = sorted(Path(sys.argv[1]).glob("*.toml"))
    if not files:
        raise SystemExit(f"no gain files in {sys.argv[1]}")
    seen = []
    for path in files:
        file = tomllib.loads(path.read_text())
        claims = {key: file[key] for key in ("plant", "delay", "vehicle", "platoon") if key in file}
        if claims in seen:
            print(f"{path.stem:22} has the proofs of another file")
            continue
        seen.append(claims)
        for what, ours, theirs in proofs(file):
            off = ours / theirs - 1
            wrong = not -SOLVER_ERROR <= off <= TOLERANCE
            bad += wrong
            print(f"{path.stem:22} {what:26} {ours:.4f} {theirs:.5f} {100 * off:+.2f} %{' WRONG' * wrong}")
    if bad:
        raise SystemExit(f"{bad} gammas differ")


if __name__ == "__main__":
    main()
