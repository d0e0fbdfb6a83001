"""Reads a merged run with the stock MCAP packages and checks that it says what it should.

Needs the Python packages mcap, mcap-ros2-support, mcap-protobuf-support and cantools:

    python tests/interop/mcap_readers.py RUN.mcap

Checks, in this order: the file has its summary, attachments and metadata; every topic of the
contract is there and every message decodes with the stock decoders; log times are in order;
every raw frame of the contract has its decoded message, and each decoded signal equals what
cantools makes of the raw frame with the attached .dbc (platoon.dbc, j1939.dbc or both), and a J1939
signal that is not available has no value but says so. A run recorded with --capture has raw frames
in the spans kept whole, and in those all of this holds; elsewhere it must have none. Exits with 1
and one line per finding when something differs, with 2 when the file cannot be read.
"""

import collections
import re
import sys

import cantools
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

from j1939_codes import is_described, meaning

CAN_FRAME_FIELDS = (
    "header id is_extended is_error len data is_fd brs esi is_rtr tx tick".split()
)
# What a run of each profile cannot be without.
MESSAGES = {
    "platoon.dbc": ("EgoState", "Actuation", "Mission"),
    "j1939.dbc": ("NavTime", "VDC2", "TSC1", "XBR", "SteerCommand", "MissionPlatoon"),
}
FINDINGS_MAX = 20


def snake_case(name):
    return re.sub(r"(?<=[^_A-Z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def spans_kept_whole(reader):
    """Log times from and until which a run has its raw frames; None when it is whole."""
    told = {record.name: record.metadata for record in reader.iter_metadata()}
    if "platoon.capture" not in told:
        return None
    start_ns = int(told["platoon.merged"]["start_wall_ns"])
    spans = re.findall(r"(\d+)-(\d+)", told["platoon.capture"]["spans_ns"])
    return [(start_ns + int(begin), start_ns + int(end)) for begin, end in spans]


class Check:
    def __init__(self, reader):
        self.findings = []
        self.counts = collections.Counter()
        self.compared = 0
        self.pending = {}
        self.thinned = set()
        attachments = {a.name: a for a in reader.iter_attachments()}
        self.dbcs = [name for name in MESSAGES if name in attachments]
        self.require(self.dbcs, f"none of {', '.join(MESSAGES)} is attached")
        self.require(
            any(name.endswith(".toml") for name in attachments),
            "no scenario (.toml) is attached",
        )
        self.whole = spans_kept_whole(reader)
        self.by_id, self.by_name = {}, {}
        for name in self.dbcs:
            text = attachments[name].data.decode()
            for known in cantools.database.load_string(text, "dbc").messages:
                self.by_id[known.frame_id] = self.by_name[known.name] = known

    def require(self, holds, text):
        if not holds:
            self.findings.append(text)

    def has_frames(self, time_ns):
        return self.whole is None or any(begin <= time_ns < end for begin, end in self.whole)

    def message(self, channel, message, decoded):
        self.counts[channel.topic] += 1
        if not self.has_frames(message.log_time):
            is_decoded = channel.topic.startswith(("/bus", "/world", "/scene", "/tf"))
            is_tick = re.fullmatch(r"/ecu\d+/(tick|dropped)", channel.topic)
            self.require(is_decoded or is_tick, f"{channel.topic}: outside of what was captured")
        elif re.fullmatch(r"/can/[^/]+/frames", channel.topic):
            self.raw_frame(channel, message, decoded)
        elif re.fullmatch(r"/ecu\d+/rx", channel.topic):
            self.frame_fields(channel.topic, decoded)
        elif match := re.fullmatch(r"/bus(\d+)/(\w+)", channel.topic):
            thinned = "least_period_ns" in channel.metadata
            self.decoded_signals((match[1], match[2]), message, decoded, thinned)

    def frame_fields(self, topic, frame):
        self.require(
            all(hasattr(frame, field) for field in CAN_FRAME_FIELDS),
            f"{topic}: a field of CanFrame is missing",
        )
        self.require(
            frame.is_rtr or frame.len == len(frame.data),
            f"{topic}: len {frame.len} but {len(frame.data)} bytes",
        )

    def raw_frame(self, channel, message, frame):
        self.frame_fields(channel.topic, frame)
        bus = re.search(r"\d+", channel.topic.split("/")[2])[0]
        known = self.by_id.get(frame.id)
        is_kind = known and frame.is_fd == known.is_fd and frame.is_extended
        if is_kind and len(frame.data) == known.length:
            queue = self.pending.setdefault((bus, known.name), collections.deque())
            queue.append((message.log_time, message.sequence, bytes(frame.data)))

    def decoded_signals(self, key, message, decoded, thinned):
        bus, name = key
        queue = self.pending.get(key, collections.deque())
        where = f"/bus{bus}/{name} at {message.log_time} ns"
        place = (message.log_time, message.sequence)
        while thinned and queue and queue[0][:2] != place:
            queue.popleft()
        if thinned:
            self.thinned.add(key)
        if not queue or queue[0][:2] != place:
            self.findings.append(f"{where}: no raw frame of this time and number")
            return
        data = queue.popleft()[2]
        dbc_message = self.by_name[name]
        numbers = dbc_message.decode(data, decode_choices=False)
        raws = dbc_message.decode(data, decode_choices=False, scaling=False)
        for signal in dbc_message.signals:
            self.signal(where, signal, numbers, raws, decoded)

    def signal(self, where, signal, numbers, raws, decoded):
        field = snake_case(signal.name)
        if signal.multiplexer_ids and signal.name not in numbers:
            self.require(not decoded.HasField(field), f"{where}: {field} is of another page")
            return
        self.compared += 1
        code = meaning(signal, raws[signal.name])
        if code:
            self.require(not decoded.HasField(field), f"{where}: {field} is a number, not {code}")
        else:
            value = getattr(decoded, field)
            self.require(
                value == numbers[signal.name],
                f"{where}: {field} is {value!r}, cantools says {numbers[signal.name]!r}",
            )
        if signal.choices:
            only_codes = not is_described(signal) and hasattr(decoded, field + "_status")
            field += "_status" if only_codes else "_text"
            text = getattr(decoded, field)
            known = str(signal.choices.get(raws[signal.name], ""))
            expected = code.replace("_", " ") if code else known
            self.require(text == expected, f"{where}: {field} is {text!r}, not {expected!r}")

    def finish(self, summary, metadata):
        for key, queue in self.pending.items():
            decoded_all = not queue or key in self.thinned
            self.require(decoded_all, f"/bus{key[0]}/{key[1]}: {len(queue)} frames not decoded")
        topics = set(self.counts)
        for pattern in (
            r"/can/[^/]+/frames",
            r"/ecu\d+/rx",
            r"/ecu\d+/tick",
            r"/world/truth",
            r"/scene",
            *(rf"/bus\d+/{name}" for dbc in self.dbcs for name in MESSAGES[dbc]),
        ):
            found = any(re.fullmatch(pattern, topic) for topic in topics)
            self.require(found, f"no topic like {pattern}")
        self.require(metadata, "there is no metadata")
        self.require(
            summary is not None
            and summary.statistics.message_count == sum(self.counts.values()),
            "the summary counts another number of messages",
        )


def main(path):
    with open(path, "rb") as file:
        factories = [Ros2(), Protobuf()]
        reader = make_reader(file, decoder_factories=factories, validate_crcs=True)
        check = Check(reader)
        last = 0
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            log_time_order=False
        ):
            check.require(message.log_time >= last, f"{channel.topic}: log time goes back")
            last = message.log_time
            check.message(channel, message, decoded)
            if len(check.findings) > FINDINGS_MAX:
                break
        else:
            check.finish(reader.get_summary(), list(reader.iter_metadata()))
    for finding in check.findings[:FINDINGS_MAX]:
        print(finding, file=sys.stderr)
    for topic, count in sorted(check.counts.items()):
        print(f"{count:9} {topic}")
    print(f"{check.compared} signals compared with cantools, {len(check.findings)} findings")
    return 1 if check.findings else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        sys.exit(main(sys.argv[1]))
    except (OSError, McapError) as error:
        print(f"{sys.argv[1]}: {error}", file=sys.stderr)
        sys.exit(2)
