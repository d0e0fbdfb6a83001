"""Reads candump's log of a run with the programs CAN people use, and compares what they see.

    python tests/interop/candump_readers.py RUN.mcap CANDUMP.log [DATABASE.dbc]

Needs the Python packages of requirements.txt and, where it is installed, tshark; a missing one is
named on a line that begins with "left out:". The frames themselves are compared with the trace by
candump_equals_mcap.py. Here:

cantools   `list` and `dump` know every message of the database and warn of nothing;
           `decode` finds a message in every line and gives the values of the trace's decoded topics;
tshark     sees as many frames, with the same times, identifiers, lengths, flags and bytes;
python-can reads the log, and what it converts the log to: .blf, .asc and .mf4;
asammdf    reads the .mf4 and extracts the database's signals with the values cantools decodes.

Exits with 1 and says what differs first.
"""

import collections
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import can
import cantools
try:
    from asammdf import MDF
    from asammdf.blocks.bus_logging_utils import MAX_VALID_J1939
except ImportError:
    MDF = None
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from candump_equals_mcap import BRS, ESI, Frame, of_candump
from mcap_readers import snake_case

DEFAULT_DBC = pathlib.Path(__file__).resolve().parents[2] / "can-dbc" / "platoon.dbc"
GROUP = re.compile(r"CAN(\d+) .*?0x([0-9A-F]+)")
DECODED = re.compile(r"\(\S+\) (truck\d+) [0-9A-F]+#\S+ :: (\w+)\((.*)\)$")


def require(holds, text):
    if not holds:
        sys.exit(f"candump_readers: {text}")


def same(what, ours, theirs):
    """Asserts that two lists are the same, naming the first difference."""
    for number, (one, other) in enumerate(zip(ours, theirs)):
        require(one == other, f"{what}: frame {number}:\n  log {one}\n  {what} {other}")
    require(len(ours) == len(theirs), f"{what}: {len(theirs)} of {len(ours)} frames")


def cantools_says(*words, read=subprocess.DEVNULL):
    """What a command of cantools prints, without a warning."""
    words = [sys.executable, "-W", "default", "-m", "cantools", *map(str, words)]
    done = subprocess.run(words, stdin=read, capture_output=True, text=True, check=True)
    require(not done.stderr, f"cantools {words[5]} warns: {done.stderr}")
    return done.stdout


def by_cantools(log, dbc, trace):
    """The database is as it should be, and every line decodes, to the values of the trace."""
    names = {message.name for message in cantools.database.load_file(str(dbc)).messages}
    require(set(cantools_says("list", dbc).split()) >= names, "cantools list misses some")
    dumped = cantools_says("dump", dbc)
    missing = [name for name in names if f" {name}\n" not in dumped]
    require(not missing, f"cantools dump misses {missing}")
    with open(log, "rb") as lines:
        printed = cantools_says("decode", "--single-line", dbc, read=lines)
    decoded = collections.defaultdict(list)
    for line in printed.splitlines():
        match = DECODED.match(line.strip())
        require(match, f"cantools decodes no message from: {line}")
        interface, name, signals = match.groups()
        decoded[interface, name].append(dict(pair.split(": ") for pair in signals.split(", ")))
    compared = compare_with_trace(decoded, trace)
    print(f"cantools decode: {sum(map(len, decoded.values()))} messages, {compared} values as traced")


def compare_with_trace(decoded, trace):
    """Each value of the trace's decoded messages, with what cantools prints of the same frame.

    A run's decoded messages are thinned out: those of the log that lie between two of them are
    stepped over. A channel that is not thinned has one for each.
    """
    compared = 0
    places, taken, thinned = collections.Counter(), collections.Counter(), set()
    with open(trace, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = [channel.topic for channel in reader.get_summary().channels.values()]
        topics = [topic for topic in topics if re.fullmatch(r"/bus\d+/\w+", topic)]
        for _, channel, _, message in reader.iter_decoded_messages(topics=topics):
            bus, name = re.match(r"/bus(\d+)/(\w+)", channel.topic).groups()
            key = (f"truck{bus}", name)
            if "least_period_ns" in channel.metadata:
                thinned.add(key)
            place = places[key]
            while key in thinned and place < len(decoded[key]):
                if not disagreement(decoded[key][place], message):
                    break
                place += 1
            require(place < len(decoded[key]), f"{key}: the log has nothing like {message}")
            what = disagreement(decoded[key][place], message)
            require(not what, f"{key} {place}: {what}")
            places[key], taken[key] = place + 1, taken[key] + 1
            compared += len(decoded[key][place])
    for key, messages in decoded.items():
        is_all = taken[key] > 0 if key in thinned else taken[key] == len(messages)
        require(is_all, f"{key}: {len(messages)} in the log, {taken[key]}")
    return compared


def disagreement(printed, message):
    """The first signal of which cantools prints something else than the trace's message has."""
    for signal, text in printed.items():
        field = snake_case(signal)
        ours = getattr(message, field)
        named = getattr(message, f"{field}_text", "") or getattr(message, f"{field}_status", "")
        if not (text == named if named else number(text) == ours):
            return f"{signal} is {ours} {named}, cantools says {text}"
    return None


def number(text):
    """The number that cantools prints before the unit; none where it prints a name instead."""
    try:
        return float(text.split()[0])
    except ValueError:
        return None


def by_tshark(log, frames):
    """What Wireshark's reader of candump logs makes of it."""
    if not shutil.which("tshark"):
        print("left out: tshark is not installed (Debian package tshark)")
        return
    # Fields of both dissectors, can and canfd; the missing ones stay empty.
    fields = "frame.time_epoch can.id can.flags.xtd can.flags.rtr can.len canfd.flags.brs"
    fields += " canfd.flags.esi data.data"
    words = ["tshark", "-r", log, "-T", "fields"]
    words += [word for field in fields.split() for word in ("-e", field)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    seen = []
    for line in done.stdout.splitlines():
        time, identifier, extended, remote, length, brs, esi, data = line.split("\t")
        flags = (brs in ("1", "True")) * BRS | (esi in ("1", "True")) * ESI
        seen.append(
            Frame(
                id=int(identifier, 0),
                is_extended=extended in ("1", "True"),
                is_error=False,
                is_rtr=remote in ("1", "True"),
                is_fd=brs != "",
                flags=flags,
                length=int(length),
                data=bytes.fromhex(data),
                time_us=round(float(time[:-3]) * 1e6),
            )
        )
    same("tshark", frames, seen)
    print(f"tshark: {len(seen)} frames, all alike")


def of_python_can(message):
    """python-can's message as a frame; the time apart, because formats round it."""
    return Frame(
        id=message.arbitration_id,
        is_extended=message.is_extended_id,
        is_error=message.is_error_frame,
        is_rtr=message.is_remote_frame,
        is_fd=message.is_fd,
        flags=message.bitrate_switch * BRS | message.error_state_indicator * ESI,
        length=message.dlc,
        data=bytes(message.data),
        time_us=0,
    )


def by_python_can(log, frames, folder):
    """The log, and each format it can be converted to; returns the path of the .mf4."""
    frames = [frame._replace(time_us=0) for frame in frames]
    messages = list(can.LogReader(log))
    same("python-can's reader", frames, [of_python_can(message) for message in messages])
    for suffix in (".blf", ".asc", ".mf4"):
        path = folder / f"run{suffix}"
        with can.Logger(path) as logger:
            for message in messages:
                logger(message)
        with can.LogReader(path) as reader:
            back = list(reader)
        same(f"python-can's {suffix}", frames, [of_python_can(message) for message in back])
        # Some formats count from the first frame.
        begin, begin_back = messages[0].timestamp, back[0].timestamp
        drift_s = max(
            abs((a.timestamp - begin) - (b.timestamp - begin_back)) for a, b in zip(messages, back)
        )
        require(drift_s < 2e-6, f"{suffix}: a time is {drift_s} s off")
        print(f"python-can: {len(back)} frames through {suffix}")
    return folder / "run.mf4"


def by_asammdf(path, dbc, log):
    """The signals that asammdf extracts, with the values that cantools decodes."""
    if MDF is None:
        print("left out: asammdf is not installed (Python package asammdf)")
        return
    rows = collections.defaultdict(list)
    database = cantools.database.load_file(str(dbc))
    for interface, frame in log:
        rows[int(interface.removeprefix("truck")), frame.id].append(frame.data)
    compared = 0
    with MDF(path) as mdf, mdf.extract_bus_logging({"CAN": [(str(dbc), 0)]}) as extracted:
        for number, group in enumerate(extracted.groups):
            bus, identifier = GROUP.match(group.channel_group.comment).groups()
            message = database.get_message_by_frame_id(int(identifier, 16))
            if message.is_multiplexed():
                continue
            data = rows.pop((int(bus), message.frame_id))
            times = extracted.get_master(number).tolist()
            where = f"asammdf: {message.name} on bus {bus}"
            require(len(times) == len(data), f"{where}: {len(times)} of {len(data)}")
            indices = {channel.name: i for i, channel in enumerate(group.channels)}
            for signal in message.signals:
                found = {}
                if signal.name in indices:
                    samples = extracted.get(group=number, index=indices[signal.name])
                    found = dict(zip(samples.timestamps.tolist(), samples.samples))
                for time, one in zip(times, data):
                    check_sample(f"{where}: {signal.name}", message, signal, one, found.get(time))
                compared += len(found)
    left = {key for key in rows if not database.get_message_by_frame_id(key[1]).is_multiplexed()}
    require(not left, f"asammdf did not extract {left}")
    print(f"asammdf: {compared} samples as cantools decodes them")


def check_sample(where, message, signal, data, theirs):
    """A value of asammdf against that of cantools. asammdf leaves out values from the range that
    J1939 reserves for what is not available, even those of counters."""
    if theirs is None:
        raw = message.decode(data, decode_choices=False, scaling=False)[signal.name]
        valid_max = MAX_VALID_J1939.get(signal.length, math.inf)
        require(raw > valid_max, f"{where}: no sample of raw {raw}")
        return
    ours = message.decode(data)[signal.name]
    if is_named(ours) and theirs != theirs:
        return  # what is not available among numbers is no number
    text = theirs.decode() if isinstance(theirs, bytes) else theirs
    agrees = str(ours) == text if is_named(ours) else math.isclose(ours, float(text))
    require(agrees, f"{where}: {theirs}, cantools says {ours}")


def is_named(value):
    return isinstance(value, cantools.database.namedsignalvalue.NamedSignalValue)


def main(trace, path, dbc=DEFAULT_DBC):
    with open(path, encoding="ascii") as lines:
        log = [of_candump(line.rstrip("\n")) for line in lines]
    frames = [frame for _, frame in log]
    by_cantools(path, dbc, trace)
    by_tshark(path, frames)
    with tempfile.TemporaryDirectory() as folder:
        mf4 = by_python_can(path, frames, pathlib.Path(folder))
        by_asammdf(mf4, dbc, log)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
