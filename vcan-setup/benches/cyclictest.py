#!/usr/bin/env python3
"""How late a thread wakes, by our sentinel and by cyclictest, in turns.

Both measure with the same priority, period and CPU for a few seconds each, one after the other and
in changing order, so that what disturbs the machine falls on both alike. Beside them cyclictest is
held against itself in the same way: what two runs of the same program differ by. Prints every pair
and the median of the ratios at p50 and p99. Needs root and cyclictest (Debian's rt-tests).

    vcan-setup/benches/cyclictest.py PLATOON [--pairs 20] [--seconds 5] [--cpu 1]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

# Latencies from here on [us] are counted, but not told apart by cyclictest.
HISTOGRAM_US = 20_000


def measure(command, path):
    """The histogram that a command leaves: counts by microsecond, rounded down."""
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (thread,) = json.loads(path.read_text())["thread"].values()
    bins = {int(us): count for us, count in thread["histogram"].items()}
    overflow = thread["cycles"] - sum(bins.values())
    if overflow > 0:
        bins[HISTOGRAM_US] = bins.get(HISTOGRAM_US, 0) + overflow
    return bins


def quantile(bins, share):
    """A quantile [us], its place within a microsecond by proportion."""
    wanted = share * sum(bins.values())
    for us, count in sorted(bins.items()):
        if wanted <= count:
            return us + wanted / count
        wanted -= count
    raise ValueError("an empty histogram")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("platoon", type=Path, help="the command")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--seconds", type=int, default=5)
    parser.add_argument("--cpu", type=int, default=1)
    parser.add_argument("--period-us", type=int, default=1000)
    parser.add_argument("--priority", type=int, default=81)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "histogram.json"
        cyclictest = [
            "cyclictest", "--quiet", "--mlockall", "--threads=1", f"--affinity={options.cpu}",
            f"--priority={options.priority}", f"--interval={options.period_us}",
            f"--duration={options.seconds}", f"--histogram={HISTOGRAM_US}", f"--json={path}",
        ]
        ours = [
            str(options.platoon), "floor", f"--cpus={options.cpu}",
            f"--priority={options.priority}", f"--period-us={options.period_us}",
            f"--duration-s={options.seconds}", f"--json={path}",
        ]
        pairs = {"sentinel": ours, "cyclictest": cyclictest}
        ratios = {name: {0.5: [], 0.99: []} for name in pairs}
        print("against cyclictest      p50 us         p99 us", flush=True)
        for number in range(options.pairs):
            for name, command in pairs.items():
                order = [command, cyclictest] if number % 2 == 0 else [cyclictest, command]
                seen = [measure(one, path) for one in order]
                a, b = seen if number % 2 == 0 else reversed(seen)
                line = f"{number + 1:3} {name:10}"
                for share, found in ratios[name].items():
                    found.append(quantile(a, share) / quantile(b, share))
                    line += f"  {quantile(a, share):6.2f} /{quantile(b, share):6.2f}"
                print(line, flush=True)
    for name, found in ratios.items():
        p50, p99 = (statistics.median(found[share]) for share in (0.5, 0.99))
        print(f"{name}/cyclictest, median of {options.pairs}: p50 {p50:.3f}, p99 {p99:.3f}")


if __name__ == "__main__":
    sys.exit(main())
