"""Attaches python-can to our UDP bus as it is: it must hear us, and we it.

    python tests/interop/python_can_udp.py target/debug/examples/udp_peer

Needs a route for multicast, as python-can itself does: without a network,
`ip route add 239.0.0.0/8 dev lo`. Exits 1 on the first frame that does not come back.
"""

import pathlib
import socket
import subprocess
import sys
import time

import can
import cantools

from e2e_profile5 import protected

DBC = pathlib.Path(__file__).resolve().parents[2] / "can-dbc" / "platoon.dbc"
PATIENCE_S = 5.0


def frames():
    data = bytes(range(1, 65))
    for length in range(9):
        yield can.Message(arbitration_id=0x122, is_extended_id=False, data=data[:length])
        yield can.Message(arbitration_id=0x18ABCDE0, data=data[:length])
        yield can.Message(
            arbitration_id=0x10, is_extended_id=False, is_remote_frame=True, dlc=length
        )
    for length in [0, 1, 8, 12, 16, 20, 24, 32, 48, 64]:
        for switch, error in [(False, False), (True, False), (True, True)]:
            yield can.Message(
                arbitration_id=0x18ABCDE0,
                data=data[:length],
                is_fd=True,
                bitrate_switch=switch,
                error_state_indicator=error,
            )


def wait_for(bus, arbitration_id):
    """The next frame with this identifier; python-can also hears what it sent itself."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        message = bus.recv(timeout=deadline - time.monotonic())
        if message is not None and message.arbitration_id == arbitration_id:
            return message
    sys.exit(f"no frame 0x{arbitration_id:X} within {PATIENCE_S} s")


def check_echoes(bus):
    count = 0
    for sent in frames():
        bus.send(sent)
        back = wait_for(bus, sent.arbitration_id ^ 1)
        back.arbitration_id ^= 1
        if not back.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False):
            sys.exit(f"sent {sent!r}\nback {back!r}")
        if back.channel != "truck0" or abs(back.timestamp - time.time()) > 60:
            sys.exit(f"channel {back.channel!r}, timestamp {back.timestamp}")
        count += 1
    return count


def check_contract(bus):
    """cantools writes an EgoState, we answer it, cantools reads the answer."""
    database = cantools.database.load_file(str(DBC))
    ego = database.get_message_by_name("EgoState")
    actuation = database.get_message_by_name("Actuation")
    signals = {signal.name: 0 for signal in ego.signals if not signal.name.startswith("E2e")}
    for tick in range(1, 301):
        data = protected(ego, {**signals, "Tick": tick, "SpeedForward": 20.0}, tick % 256)
        bus.send(
            can.Message(arbitration_id=ego.frame_id, data=data, is_fd=True, bitrate_switch=True)
        )
        answer = actuation.decode(wait_for(bus, actuation.frame_id).data)
        if (answer["AnswersTick"], answer["Force"]) != (tick, -250.5):
            sys.exit(f"tick {tick} was answered with {answer}")
    return tick


def main():
    peer = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        word, group, port = peer.stdout.readline().split()
        assert word == "listening"
        with can.Bus(group, interface="udp_multicast", port=int(port)) as bus:
            echoes = check_echoes(bus)
            answers = check_contract(bus)
            # While python-can has joined: the kernel takes the group on its interface only then.
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"no frame at all", (group, int(port)))
                time.sleep(0.2)
        counts = peer.communicate(timeout=PATIENCE_S)[0]
    finally:
        peer.kill()
    if peer.returncode != 0 or "malformed: 1," not in counts:
        sys.exit(f"the peer ended with {peer.returncode}: {counts}")
    print(f"python-can {can.__version__}: {echoes} frames and {answers} ticks, there and back")


if __name__ == "__main__":
    main()
