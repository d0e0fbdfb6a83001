"""The recorded QPs, solved by our solver and by its peers in one run; prints a Markdown table.

Every peer is asked for its own account of setup and solve, where it keeps one; where it keeps none,
the wall clock around the call is taken and said so. All start cold. `interleaved`: every QP goes to
every solver, in a drawn order, so each finds the caches as others left them. `alone`: each solver goes over
all QPs by itself. Ratios are medians of the ratio to DAQP on the same QP in the same round.

    peers.py LIBRARY RECORDED [ROUNDS]

LIBRARY is our solver as a shared library, RECORDED the file of recorded QPs.
"""

import ctypes
import os
import random
import statistics
import struct
import sys
import time

import casadi
import clarabel
import daqp
import numpy as np
import osqp
import piqp
import proxsuite
import quadprog
import scipy.sparse as sparse

VARIABLES, ROWS = 13, 111
CONSTRAINTS = VARIABLES + ROWS
INFINITY = 1e30


def recorded(path):
    """H, g, A, lower, upper (bounds first) and the solution of every QP in the file."""
    with open(path, "rb") as file:
        data = file.read()
    assert data[:8] == b"PLATOONQ"
    count, pairs, slots = struct.unpack_from("<III", data, 8)
    length = VARIABLES * VARIABLES + VARIABLES + ROWS * VARIABLES + 2 * CONSTRAINTS
    at = 20
    template = np.frombuffer(data, "<f8", length, at)
    at += 8 * length
    places, values_of = np.frombuffer(data, "<u2", 2 * pairs, at).reshape(-1, 2).T
    at += 4 * pairs
    cuts = np.cumsum([VARIABLES * VARIABLES, VARIABLES, ROWS * VARIABLES, CONSTRAINTS])
    for _ in range(count):
        values = np.frombuffer(data, "<f8", slots, at + 4)
        exact = np.frombuffer(data, "<f8", VARIABLES, at + 4 + 8 * slots)
        at += 4 + 8 * (slots + VARIABLES)
        flat = template.copy()
        flat[places] = values[values_of]
        h, g, a, lower, upper = np.split(flat, cuts)
        yield (
            np.ascontiguousarray(h.reshape(VARIABLES, VARIABLES)),
            g,
            np.ascontiguousarray(a.reshape(ROWS, VARIABLES)),
            np.maximum(lower, -INFINITY),
            np.minimum(upper, INFINITY),
            exact,
        )


class Ours:
    """Our solver, loaded into this process like its peers; it has the recorded QPs itself."""

    name, clock, entry = "platoon", "own", "solve_cold"

    def __init__(self, library, problems):
        self.library = ctypes.CDLL(library)
        self.library.variable.restype = ctypes.c_double
        self.timed_solve = getattr(self.library, self.entry)
        self.timed_solve.restype = ctypes.c_uint64

    def __call__(self, number):
        seconds = 1e-9 * self.timed_solve(number)
        return seconds, np.array([self.library.variable(i) for i in range(VARIABLES)])


class OursWarm(Ours):
    """The same, started with the working set of the QP recorded before."""

    name, entry = "platoon, warm", "solve_warm"


class Peer:
    """A solver that is a Python package; `clock` says whose time is taken."""

    clock = "own"

    def __init__(self, _library, problems):
        self.problems = [self.prepared(*problem[:5]) for problem in problems]

    def prepared(self, h, g, a, lower, upper):
        return h, g, a, lower, upper

    def __call__(self, number):
        return self.solve(*self.problems[number])


class Daqp(Peer):
    name = "DAQP"

    def prepared(self, h, g, a, lower, upper):
        sense = np.zeros(CONSTRAINTS, dtype=np.int32)
        return h, g, a, upper.copy(), lower.copy(), sense

    def solve(self, *problem):
        z, _, _, info = daqp.solve(*problem)
        return info["setup_time"] + info["solve_time"], np.array(z)


class Piqp(Peer):
    name = "PIQP"

    def solve(self, h, g, a, lower, upper):
        solver = piqp.DenseSolver()
        solver.settings.compute_timings = True
        n = VARIABLES
        solver.setup(h, g, None, None, a, lower[n:], upper[n:], lower[:n], upper[:n])
        solver.solve()
        info = solver.result.info
        return info.setup_time + info.solve_time, np.array(solver.result.x)


class Proxqp(Peer):
    name = "ProxQP"

    def solve(self, h, g, a, lower, upper):
        solver = proxsuite.proxqp.dense.QP(VARIABLES, 0, ROWS, True)
        solver.settings.eps_abs = 1e-6
        solver.settings.compute_timings = True
        n = VARIABLES
        solver.init(h, g, None, None, a, lower[n:], upper[n:], lower[:n], upper[:n])
        solver.solve()
        info = solver.results.info
        return 1e-6 * (info.setup_time + info.solve_time), np.array(solver.results.x)


class Qpoases(Peer):
    name, clock = "qpOASES (CasADi)", "CasADi's"

    def __init__(self, library, problems):
        sizes = {"h": casadi.Sparsity.dense(13, 13), "a": casadi.Sparsity.dense(ROWS, 13)}
        self.sizes = sizes
        self.options = {"printLevel": "none", "record_time": True}
        super().__init__(library, problems)

    def prepared(self, h, g, a, lower, upper):
        n = VARIABLES
        return {
            "h": casadi.DM(h),
            "g": casadi.DM(g),
            "a": casadi.DM(a),
            "lbx": casadi.DM(lower[:n]),
            "ubx": casadi.DM(upper[:n]),
            "lba": casadi.DM(lower[n:]),
            "uba": casadi.DM(upper[n:]),
        }

    def solve(self, **problem):
        # A fresh one each time: the plug-in starts from its last solution otherwise.
        solver = casadi.conic("qpoases", "qpoases", self.sizes, self.options)
        z = solver(**problem)["x"]
        return solver.stats()["t_wall_solver"], np.array(z).ravel()

    def __call__(self, number):
        return self.solve(**self.problems[number])


class Osqp(Peer):
    name = "OSQP"

    def prepared(self, h, g, a, lower, upper):
        rows = sparse.csc_matrix(np.vstack([np.eye(VARIABLES), a]))
        return sparse.csc_matrix(np.triu(h)), g, rows, lower, upper

    def solve(self, *problem):
        solver = osqp.OSQP()
        solver.setup(*problem, eps_abs=1e-5, eps_rel=1e-5, max_iter=20000, verbose=False)
        result = solver.solve()
        return result.info.setup_time + result.info.solve_time, np.array(result.x)


class Quadprog(Peer):
    name, clock = "quadprog", "wall"

    def prepared(self, h, g, a, lower, upper):
        rows = np.vstack([np.eye(VARIABLES), a])
        is_low, is_high = lower > -INFINITY, upper < INFINITY
        normals = np.vstack([rows[is_low], -rows[is_high]])
        limits = np.concatenate([lower[is_low], -upper[is_high]])
        return h, -g, np.ascontiguousarray(normals.T), limits

    def solve(self, *problem):
        began = time.perf_counter()
        z = quadprog.solve_qp(*problem)[0]
        return time.perf_counter() - began, z


class Clarabel(Peer):
    name, clock = "Clarabel", "wall"

    def prepared(self, h, g, a, lower, upper):
        rows = np.vstack([np.eye(VARIABLES), a])
        is_low, is_high = lower > -INFINITY, upper < INFINITY
        normals = sparse.csc_matrix(np.vstack([rows[is_high], -rows[is_low]]))
        limits = np.concatenate([upper[is_high], -lower[is_low]])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        cones = [clarabel.NonnegativeConeT(len(limits))]
        return sparse.csc_matrix(np.triu(h)), g, normals, limits, cones, settings

    def solve(self, *problem):
        began = time.perf_counter()
        result = clarabel.DefaultSolver(*problem).solve()
        return time.perf_counter() - began, np.array(result.x)


KINDS = [Ours, Daqp, Quadprog, Qpoases, Piqp, Proxqp, Osqp, Clarabel]


def run(solvers, order, exact):
    """Seconds of every solver for every QP, in the order given, and the largest errors."""
    times = {solver.name: [] for solver in solvers}
    errors = dict.fromkeys(times, 0.0)
    for solver, number in order:
        seconds, z = solver(number)
        times[solver.name].append(seconds)
        errors[solver.name] = max(errors[solver.name], np.abs(z - exact[number]).max())
    return times, errors


def quantile(values, share):
    ordered = sorted(values)
    return ordered[int(share * (len(ordered) - 1))]


def table(title, solvers, rounds, errors):
    """A row for each solver over all rounds."""
    print(f"\n{title}\n")
    print("| solver | median µs | p99 µs | of DAQP: median (p10 to p90) | p99 | error | clock |")
    print("|---|---|---|---|---|---|---|")
    everything = {s.name: [t for times in rounds for t in times[s.name]] for s in solvers}
    daqp_s = everything["DAQP"]
    for solver in solvers:
        own = everything[solver.name]
        ratios = [a / b for a, b in zip(own, daqp_s)]
        low, middle, high = (quantile(ratios, share) for share in (0.1, 0.5, 0.9))
        p99 = quantile(own, 0.99)
        print(
            f"| {solver.name} | {1e6 * statistics.median(own):.2f} | {1e6 * p99:.2f} "
            f"| {middle:.3f} ({low:.3f} to {high:.3f}) | {p99 / quantile(daqp_s, 0.99):.3f} "
            f"| {errors[solver.name]:.0e} | {solver.clock} |"
        )


def quieten():
    """qpOASES prints its licence for every problem: only what is printed to the result is kept."""
    result = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.stdout = result


def main():
    quieten()
    problems = list(recorded(sys.argv[2]))
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    exact = [problem[5] for problem in problems]
    solvers = [kind(sys.argv[1], problems) for kind in KINDS]
    # Never beside the cold one, which would find its problem and itself in the caches.
    warm = OursWarm(sys.argv[1], problems)
    numbers = range(len(problems))
    hard = [n for n in numbers if (np.abs(exact[n][10:]) > 1e-9).any() or limited(problems[n])]
    print(f"{len(problems)} QPs, {rounds} rounds, cold unless said otherwise")
    for which, numbers in [("all", numbers), ("those beyond the slacks' bounds", hard)]:
        for how, who, order in [
            ("interleaved", solvers, interleaved(solvers, numbers)),
            ("interleaved", [warm, *solvers[1:]], interleaved([warm, *solvers[1:]], numbers)),
            ("alone", [warm, *solvers], [(s, n) for s in [warm, *solvers] for n in numbers]),
        ]:
            measured = [run(who, order, exact) for _ in range(rounds)]
            errors = {s.name: max(e[s.name] for _, e in measured) for s in who}
            table(f"{how}, {which} ({len(numbers)})", who, [times for times, _ in measured], errors)


def interleaved(solvers, numbers):
    """Every QP by every solver, each time in another order: who ran before counts for much."""
    shuffle = random.Random(1)
    return [(s, n) for n in numbers for s in shuffle.sample(solvers, len(solvers))]


def limited(problem):
    """Whether a limit beside the slacks' bounds holds the solution."""
    h, g, _, _, _, exact = problem
    slope = h @ exact + g
    return np.abs(slope[:10]).max() > 1e-6


if __name__ == "__main__":
    main()
