"""Compares what candump logged beside a run with what the run recorded, frame for frame.

    python tests/interop/candump_equals_mcap.py RUN.mcap CANDUMP.log...

Needs the Python packages mcap and mcap-ros2-support. The logs are those of `candump -l`, started
before the run and stopped after it; several are read one after the other. On every interface of the
run both must have the same frames in the same order: identifier, kind, flags, length, bytes, and
the kernel's time of reception to the microsecond. Of candump's flags, the FDF bit that newer
versions set is left aside. Exits with 1 and names the first difference of every interface when there
is one, with 2 when a file cannot be read.
"""

import re
import sys
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

LINE = re.compile(
    r"\((\d+)\.(\d{6})\) (\S+) ([0-9A-F]{3}|[0-9A-F]{8})#"
    r"(?:#([0-9A-F])((?:[0-9A-F]{2})*)|(R[0-8]?)|((?:[0-9A-F]{2})*))(?: [TR])?$"
)
ERROR_FLAG = 0x20000000
BRS, ESI = 1, 2


class Frame(NamedTuple):
    """One frame; the fields in the order in which a difference is looked for."""

    id: int
    is_extended: bool
    is_error: bool
    is_rtr: bool
    is_fd: bool
    flags: int
    length: int
    data: bytes
    time_us: int

    def __str__(self):
        kind = "FD" if self.is_fd else "remote" if self.is_rtr else "classic"
        return (
            f"{self.id:0{8 if self.is_extended else 3}X} {kind} flags {self.flags} "
            f"[{self.length}] {self.data.hex(' ')} at {self.time_us * 1e-6:.6f} s"
        )


def of_candump(line):
    """The interface and the frame of a line of the log."""
    match = LINE.match(line)
    if not match:
        raise ValueError(f"not a line of candump -l: {line!r}")
    seconds, micros, interface, word, fd_flags, fd_data, remote, data = match.groups()
    identifier = int(word, 16)
    is_error = len(word) == 8 and bool(identifier & ERROR_FLAG)
    payload = bytes.fromhex(fd_data if fd_flags is not None else data or "")
    frame = Frame(
        id=identifier & ~ERROR_FLAG,
        is_extended=len(word) == 8 and not is_error,
        is_error=is_error,
        is_rtr=remote is not None,
        is_fd=fd_flags is not None,
        flags=int(fd_flags, 16) & (BRS | ESI) if fd_flags is not None else 0,
        length=int(remote[1:] or 0) if remote else len(payload),
        data=payload,
        time_us=int(seconds) * 1_000_000 + int(micros),
    )
    return interface, frame


def of_mcap(message):
    stamp = message.header.stamp
    return Frame(
        id=message.id,
        is_extended=message.is_extended,
        is_error=message.is_error,
        is_rtr=message.is_rtr,
        is_fd=message.is_fd,
        flags=message.brs * BRS | message.esi * ESI,
        length=message.len,
        data=bytes(message.data),
        time_us=stamp.sec * 1_000_000 + stamp.nanosec // 1000,
    )


def logged(paths):
    """Frames of the logs by interface."""
    frames = {}
    for path in paths:
        with open(path, encoding="ascii") as lines:
            for line in lines:
                interface, frame = of_candump(line.rstrip("\n"))
                frames.setdefault(interface, []).append(frame)
    return frames


def recorded(path):
    """Frames of the run by interface."""
    frames = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = [channel.topic for channel in reader.get_summary().channels.values()]
        taps = [topic for topic in topics if re.fullmatch(r"/can/[^/]+/frames", topic)]
        for _, channel, _, message in reader.iter_decoded_messages(topics=taps):
            interface = channel.metadata["interface"]
            frames.setdefault(interface, []).append(of_mcap(message))
    return frames


def first_difference(interface, run, log):
    """What differs first on an interface, in words; None when nothing does."""
    for number, (ours, theirs) in enumerate(zip(run, log)):
        if ours != theirs:
            field = next(f for f in Frame._fields if getattr(ours, f) != getattr(theirs, f))
            return (
                f"{interface}: frame {number} differs in {field}\n"
                f"  run     {ours}\n  candump {theirs}"
            )
    if len(run) != len(log):
        where, longer = ("the run", run) if len(run) > len(log) else ("candump", log)
        rest = min(len(run), len(log))
        return (
            f"{interface}: {len(run)} frames in the run, {len(log)} in candump's log; "
            f"frame {rest} only in {where}:\n  {longer[rest]}"
        )
    return None


def main(run_path, log_paths):
    run, log = recorded(run_path), logged(log_paths)
    differences = []
    for interface in sorted(run.keys() | log.keys()):
        ours, theirs = run.get(interface, []), log.get(interface, [])
        difference = first_difference(interface, ours, theirs)
        print(f"{interface}: {len(ours)} frames in the run, {len(theirs)} in candump's log")
        if difference:
            differences.append(difference)
    for difference in differences:
        print(difference, file=sys.stderr)
    if not run:
        print(f"{run_path}: no recorded frames", file=sys.stderr)
        return 1
    return 1 if differences else 0


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    try:
        sys.exit(main(sys.argv[1], sys.argv[2:]))
    except (OSError, ValueError, McapError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
