"""Attaches python-can to a run on a host without kernel CAN, and to its socketcand gateway.

    python tests/interop/python_can_run.py target/debug/platoon

Needs the Python packages of requirements.txt, and a route for multicast as python-can does. Starts
a short rehearsal over UDP and, while it runs, joins truck 1's bus as python-can's `udp_multicast`
and truck 2's as its `socketcand`, found by its beacon. On both, every frame that comes must be of
the contract and decode with cantools, and one frame of a stranger is sent. cantools' monitor joins
truck 3's bus in a terminal of its own and must show its messages. Afterwards the run must be
unharmed: the frames of the stranger are in the trace, rig and ECU have counted each as unknown, and
nothing else is wrong. Exits with 1 and says what did not hold.
"""

import json
import logging
import os
import pathlib
import pty
import re
import signal
import subprocess
import sys
import tempfile
import time

import can
import cantools
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

DBC = pathlib.Path(__file__).resolve().parents[2] / "can-dbc" / "platoon.dbc"
DURATION_S = 20
PATIENCE_S = 60.0
FRAMES = 400
STRANGER = {1: (0x123, b"\x01\x02"), 2: (0x1ABCDEF0, bytes(range(64)))}
# Everything the rig counts on a bus that must stay at zero.
FAULTS = "out_of_order bad_crc malformed repeated counter_jumps missing unechoed unrecorded".split()


def require(holds, text):
    if not holds:
        sys.exit(text)


class Run:
    """A rehearsal and where to attach to it."""

    def __init__(self, program, folder):
        self.folder = folder
        words = "rehearse --bus udp --socketcand 0 --socketcand-beacon --rate-hz 100"
        words += f" --duration-s {DURATION_S} --out"
        self.process = subprocess.Popen(
            [program, *words.split(), folder / "run"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        match = None
        while not match:
            line = self.process.stderr.readline()
            require(line, "the rehearsal ended before its gateway was open")
            match = re.search(r"attach at (\S+):(\d+)", line)
        self.gateway = match[1], int(match[2])

    def udp_port(self):
        """The port that the processes of the run were told."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            children = pathlib.Path(f"/proc/{self.process.pid}/task").glob("*/children")
            for child in [pid for path in children for pid in path.read_text().split()]:
                words = pathlib.Path(f"/proc/{child}/cmdline").read_text().split("\0")
                if "--port" in words:
                    return int(words[words.index("--port") + 1])
            time.sleep(0.05)
        sys.exit("no process of the run names its UDP port")

    def beacon(self):
        """What python-can finds by the gateway's beacon."""
        found = can.detect_available_configs(interfaces=["socketcand"])
        places = {(place["host"], place["port"], place["channel"]) for place in found}
        expected = {(*self.gateway, f"truck{truck}") for truck in range(4)}
        require(places == expected, f"the beacon says {found}")

    def finish(self):
        _, words = self.process.communicate(timeout=PATIENCE_S + DURATION_S)
        require(self.process.returncode in (0, 1), f"the run ended with: {words}")
        return json.loads((self.folder / "run" / "summary.json").read_text())


def listen_and_send(bus, database, stranger):
    """Sends the stranger's frame once the bus is busy; returns the messages seen, by name."""
    identifier, data = stranger
    seen = {}
    deadline = time.monotonic() + PATIENCE_S
    while sum(seen.values()) < FRAMES:
        message = bus.recv(timeout=deadline - time.monotonic())
        require(message is not None, f"{bus.channel_info}: no frame any more after {seen}")
        if message.arbitration_id == identifier:
            continue
        known = database.get_message_by_frame_id(message.arbitration_id)
        known.decode(bytes(message.data))
        seen[known.name] = seen.get(known.name, 0) + 1
        if sum(seen.values()) == FRAMES // 2:
            bus.send(
                can.Message(
                    arbitration_id=identifier,
                    is_extended_id=identifier > 0x7FF,
                    data=data,
                    is_fd=len(data) > 8,
                    bitrate_switch=len(data) > 8,
                )
            )
    require({"EgoState", "Actuation", "EcuStatus"} <= seen.keys(), f"saw only {seen}")
    return seen


class Monitor:
    """cantools' monitor in a terminal of its own."""

    def __init__(self, port):
        words = f"-m cantools monitor -i udp_multicast -c 239.74.163.5 --bus-kwargs port={port} --fd"
        self.terminal, end = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, *words.split(), str(DBC)],
            stdin=end,
            stdout=end,
            stderr=end,
            env={**os.environ, "TERM": "xterm", "LINES": "60", "COLUMNS": "200"},
        )
        os.close(end)
        os.set_blocking(self.terminal, False)
        self.drawn = b""

    def look(self):
        try:
            self.drawn += os.read(self.terminal, 1 << 20)
        except (BlockingIOError, OSError):
            pass

    def finish(self):
        deadline = time.monotonic() + PATIENCE_S
        names = [b"EgoState(", b"Actuation(", b"V2vOut("]
        while not all(name in self.drawn for name in names) and time.monotonic() < deadline:
            self.look()
            time.sleep(0.05)
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(timeout=PATIENCE_S)
        os.close(self.terminal)
        missing = [name.decode() for name in names if name not in self.drawn]
        require(not missing, f"cantools monitor did not show {missing}: {self.drawn[-500:]}")
        require(b"arning" not in self.drawn, f"cantools monitor warns: {self.drawn[:500]}")


def strangers_in(trace):
    """What the trace has of the strangers, by bus: identifier, bytes, direction."""
    found = {}
    with open(trace, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = [f"/can/bus{bus}/frames" for bus in range(4)]
        for _, channel, _, frame in reader.iter_decoded_messages(topics=topics):
            if any(frame.id == identifier for identifier, _ in STRANGER.values()):
                bus = int(re.search(r"\d+", channel.topic)[0])
                found.setdefault(bus, []).append((frame.id, bytes(frame.data), frame.tx))
    return found


def check_unharmed(summary, folder):
    for truck, node in enumerate(summary["nodes"]):
        unknown = 1 if truck in STRANGER else 0
        require(node["unknown"] == unknown, f"the rig on bus {truck} counted {node}")
        require(not any(node[fault] for fault in FAULTS), f"faults on bus {truck}: {node}")
        require(node["accepted"] > 100, f"too few commands on bus {truck}: {node}")
    for ecu in summary["ecus"]:
        unknown = 1 if ecu["truck"] in STRANGER else 0
        received = ecu["received"]
        require(received["foreign"] == unknown, f"ECU {ecu['truck']} counted {received}")
        faults = [received[fault] for fault in ("crc", "malformed", "repeated", "lost")]
        require(not any(faults), f"ECU {ecu['truck']} counted {received}")
    found = strangers_in(folder / "run" / "run.mcap")
    expected = {bus: [(*frame, False)] for bus, frame in STRANGER.items()}
    require(found == expected, f"the trace has of the strangers: {found}")


def main(program):
    # It warns of every message that comes in two pieces.
    logging.getLogger("can").setLevel(logging.ERROR)
    database = cantools.database.load_file(str(DBC))
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run = Run(program, folder)
        try:
            monitor = Monitor(run.udp_port())
            run.beacon()
            udp = {"interface": "udp_multicast", "channel": "239.74.163.3", "port": run.udp_port()}
            host, port = run.gateway
            tcp = {"interface": "socketcand", "channel": "truck2", "host": host, "port": port}
            for truck, place in ((1, udp), (2, tcp)):
                with can.Bus(**place) as bus:
                    seen = listen_and_send(bus, database, STRANGER[truck])
                print(f"python-can {can.__version__} as {place['interface']}: saw {seen}, sent 1")
            monitor.finish()
            print("cantools monitor: shows the messages of truck 3's bus")
            summary = run.finish()
        finally:
            run.process.kill()
        check_unharmed(summary, folder)
        noted = [note for note in summary["notes"] if note.startswith("socketcand: 1 clients")]
        require(noted and "1 from them" in noted[0], f"the gateway's note: {summary['notes']}")
        print(f"the run is unharmed; {noted[0]}")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
