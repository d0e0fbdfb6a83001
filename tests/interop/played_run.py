"""Plays a run over UDP and holds what a listener hears against the recording.

    python tests/interop/played_run.py PLATOON RUN.mcap

PLATOON is the command. Joins truck 1's bus as python-can's `udp_multicast` does, has `platoon play`
put two seconds of two kinds of messages there, and checks that every frame came, in order and
as it was. How well the times between frames were kept is printed beside what the player measured;
it depends on the machine and is not judged. Exits with 1 and says what differs.
"""

import json
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import msgpack
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

GROUP, PORT = "239.74.163.3", 43177
UNTIL_S = 2.0


def recorded(run, until_s):
    """Identifier, data and bench time of the frames of truck 1's bus."""
    frames = []
    with open(run, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        start = next(m for m in reader.iter_metadata() if m.name == "platoon.merged")
        start_ns = int(start.metadata["start_wall_ns"])
        for *_, message, frame in reader.iter_decoded_messages(topics=["/can/bus1/frames"]):
            time_s = 1e-9 * (message.log_time - start_ns)
            if time_s < until_s:
                stamp = frame.header.stamp
                stamp_s = stamp.sec - start_ns // 10**9 + 1e-9 * stamp.nanosec
                frames.append((frame.id, bytes(frame.data), stamp_s))
    return frames


class Listener(threading.Thread):
    """Takes everything that comes to a group, with the time it came."""

    def __init__(self):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        self.socket.bind((GROUP, PORT))
        joined = socket.inet_aton(GROUP) + socket.inet_aton("127.0.0.1")
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
        self.socket.settimeout(0.5)
        self.heard, self.is_over = [], False
        self.start()

    def run(self):
        while True:
            try:
                packet = self.socket.recv(2048)
            except TimeoutError:
                if self.is_over:
                    return
                continue
            self.heard.append((time.monotonic(), packet))

    def frames(self):
        """Identifier, data and time of what was heard, once no more is sent."""
        self.is_over = True
        self.join()
        unpacked = [(msgpack.unpackb(packet), time_s) for time_s, packet in self.heard]
        return [(told["arbitration_id"], bytes(told["data"]), time_s) for told, time_s in unpacked]


def gaps(times_s):
    return [after - before for before, after in zip(times_s, times_s[1:])]


def main(platoon, run):
    listener = Listener()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "play.json"
        subprocess.run(
            [platoon, "play", run, "--bus", "udp", "--port", str(PORT), "--truck", "1",
             "--only", "EgoState,V2vState", "--until", str(UNTIL_S), "--json", report],
            check=True, stdout=subprocess.DEVNULL,
        )
        played = json.loads(report.read_text())
    heard = listener.frames()
    ids = {identifier for identifier, *_ in heard}
    wanted = [frame for frame in recorded(run, UNTIL_S) if frame[0] in ids]
    if [frame[:2] for frame in heard] != [frame[:2] for frame in wanted]:
        sys.exit(f"played_run: heard {len(heard)} frames, recorded are {len(wanted)}, or others")
    if len(ids) != 2 or len(heard) != played["frames"] or played["refused"]:
        sys.exit(f"played_run: heard {len(heard)} frames of {sorted(ids)}, played: {played}")
    asked, came = (gaps([time_s for *_, time_s in frames]) for frames in (wanted, heard))
    wrong_us = [1e6 * abs(a - b) for a, b in zip(asked, came)]
    p50_us, p99_us = statistics.median(wrong_us), statistics.quantiles(wrong_us, n=100)[98]
    print(f"play over udp: {len(heard)} frames as recorded; gaps wrong by p50 {p50_us:.0f}, p99 "
          f"{p99_us:.0f} µs at the listener, {played['between_us']} at the player, machine alone "
          f"{played['machine_floor_us']}, net {played['net_of_floor_us']}")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
