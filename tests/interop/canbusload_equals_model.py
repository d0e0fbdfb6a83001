"""Compares the bus load that canbusload saw beside a run with the load our model computes from it.

    python tests/interop/canbusload_equals_model.py RUN.mcap CANBUSLOAD.txt FRAME_BITS

Needs the Python packages mcap and mcap-ros2-support. CANBUSLOAD.txt is what
`canbusload -e truck0@500000 truck1@500000 ...` printed, started before the run and stopped at least
a second after it; FRAME_BITS is the program `frame_bits` of our model (cargo build -p platoon-dbc
--example frame_bits). canbusload counts the exact bits of classic frames only, so the run must be
one of the j1939 profile.

canbusload tells every second how many frames it saw since the last time and how many bits they had.
The frames of the run must be as many, and cut into the same seconds their bits by our model within
1 % of canbusload's. It has no option for a larger buffer and loses frames when it is not scheduled:
start it with `chrt --fifo 95` where the rehearsal outranks it, after
`sysctl net.core.rmem_default=16777216`. Exits with 1 when something differs, with 2 when a file
cannot be read.
"""

import re
import subprocess
import sys

from mcap.exceptions import McapError

from candump_equals_mcap import recorded

LINE = re.compile(r"\s*(\S+)@(\d+)([kM]?)\s+(\d+)\s+(\d+)\s+\d+\s+(?:\d+\s+)?\d+%")
SCALE = {"": 1, "k": 1_000, "M": 1_000_000}
TOLERANCE = 0.01


def seen_by_canbusload(path):
    """Bit rate and, per second, frames and bits of every interface."""
    seen = {}
    with open(path, encoding="ascii", errors="replace") as lines:
        for line in lines:
            if match := LINE.match(line):
                name, number, scale, frames, bits = match.groups()
                _, seconds = seen.setdefault(name, (int(number) * SCALE[scale], []))
                seconds.append((int(frames), int(bits)))
    return seen


def bits_of(frames, program):
    """The bits of every frame by our model."""
    words = []
    for frame in frames:
        identifier = f"{frame.id:0{8 if frame.is_extended else 3}X}"
        words.append(f"{identifier}#{f'R{frame.length}' if frame.is_rtr else frame.data.hex()}")
    told = subprocess.run(
        [program], input="\n".join(words) + "\n", capture_output=True, text=True, check=True
    )
    return [int(line.split()[0]) for line in told.stdout.splitlines()]


def compare(name, frames, rate, seconds, program):
    """What does not hold on one interface."""
    told = sum(count for count, _ in seconds)
    if told != len(frames):
        return [f"{name}: {len(frames)} frames in the run, {told} seen by canbusload"]
    bits = bits_of(frames, program)
    at, worst, highest = 0, 0.0, (0.0, 0.0)
    for count, theirs in seconds:
        ours = sum(bits[at : at + count])
        at += count
        worst = max(worst, abs(ours - theirs) / max(theirs, 1))
        highest = max(highest, (100 * theirs / rate, 100 * ours / rate))
    print(
        f"{name}: {len(frames)} frames; the load of a second differs by at most {100 * worst:.3f} "
        f"%; the highest is {highest[1]:.2f} % by our model, {highest[0]:.2f} % by canbusload"
    )
    return [f"{name}: more than {100 * TOLERANCE:.0f} %"] if worst > TOLERANCE else []


def main(trace, text, program):
    try:
        run, seen = recorded(trace), seen_by_canbusload(text)
    except (OSError, McapError, ValueError) as error:
        print(f"canbusload_equals_model: {error}", file=sys.stderr)
        return 2
    findings = [] if seen else [f"{text}: no line of canbusload in it"]
    for name, (rate, seconds) in sorted(seen.items()):
        findings += compare(name, run.get(name, []), rate, seconds, program)
    for finding in findings:
        print(finding)
    return 1 if findings else 0


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
