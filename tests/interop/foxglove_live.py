"""A run seen live over Foxglove's WebSocket protocol, with a stock client, beside its run.mcap.

Usage: foxglove_live.py PLATOON SCRATCH

Rehearses some seconds in real time with --live, subscribes as Foxglove does, and checks that what
was sent live is, byte for byte, in the trace that the run leaves; then that every path of
docs/foxglove-layout.json names a number that the trace has.
"""

import asyncio
import base64
import collections
import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import websockets
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"
WANTED = [
    "/world/truth", "/scene", "/scene/road", "/scene/field", "/tf", "/ecu1/tick",
    "/can/bus1/frames", "/bus1/EgoState",
]
MESSAGE_DATA = 1


async def look(address):
    """What a guest is sent until the run ends: serverInfo, the channels, data by topic and time."""
    seen = collections.defaultdict(dict)
    channels, topics, info = {}, {}, None
    async with websockets.connect(address, subprotocols=["foxglove.websocket.v1"],
                                  max_size=None) as socket:
        assert socket.subprotocol == "foxglove.websocket.v1"
        try:
            async for message in socket:
                if isinstance(message, bytes):
                    opcode, subscription, time_ns = struct.unpack_from("<BIQ", message)
                    assert opcode == MESSAGE_DATA, opcode
                    seen[topics[subscription]].setdefault(time_ns, []).append(message[13:])
                    continue
                told = json.loads(message)
                if told["op"] == "serverInfo":
                    info = told
                for channel in told.get("channels", []):
                    channels[channel["topic"]] = channel
                    if channel["topic"] in WANTED:
                        number = 100 + channel["id"]
                        topics[number] = channel["topic"]
                        wish = {"id": number, "channelId": channel["id"]}
                        await socket.send(json.dumps({"op": "subscribe", "subscriptions": [wish]}))
        except websockets.ConnectionClosedError:
            pass  # the run is over
    return info, channels, seen


async def refused(address):
    """Who speaks another protocol is told so."""
    try:
        async with websockets.connect(address, subprotocols=["chat"]):
            return False
    except websockets.InvalidStatus as error:
        return error.response.status_code == 400


async def rehearse(platoon, out):
    run = subprocess.Popen(
        [platoon, "rehearse", "obstacle-avoidance", "--bus", "udp", "--rate-hz", "50",
         "--duration-s", "6", "--live=0", "--out", out],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )
    said = ""
    for line in run.stderr:
        said += line
        if place := re.search(r"ws://[\d.:]+", line):
            break
    assert place, f"it does not say where to look: {said}"
    assert await refused(place[0]), "a guest of another protocol was let in"
    found = await look(place[0])
    run.communicate()
    # Six seconds are too few to pass anything, so the behaviour may fail; nothing else may.
    assert run.returncode in (0, 1), run.returncode
    return found


def recorded(path):
    """Data of a trace by topic and log time, and the last decoded message of each topic."""
    data, last = collections.defaultdict(dict), {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            data[channel.topic].setdefault(message.log_time, []).append(message.data)
            last[channel.topic] = (schema, message)
    return data, last


def same(seen, data):
    for topic in WANTED:
        assert seen[topic], f"{topic}: nothing was sent live"
        for time_ns, messages in seen[topic].items():
            kept = data[topic].get(time_ns)
            assert kept is not None, f"{topic}: the trace has nothing at {time_ns}"
            assert all(message in kept for message in messages), f"{topic} differs at {time_ns}"


def layout_paths():
    panels = json.loads(LAYOUT.read_text())["configById"]
    return [path["value"] for panel in panels.values() for path in panel.get("paths", [])]


def value_at(path, last):
    """The value a path of Foxglove names, such as /world/truth.trucks[2].y_m."""
    topic, *fields = re.split(r"\.(?![^\[]*\])", path)
    schema, message = last[topic]
    value = DecoderFactory().decoder_for("protobuf", schema)(message.data)
    for field in fields:
        name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()
        value = getattr(value, name)
        value = value[int(index)] if index else value
    return value


def main():
    platoon, out = sys.argv[1], Path(sys.argv[2])
    info, channels, seen = asyncio.run(rehearse(platoon, out))
    assert info and info["name"] == "platoon obstacle-avoidance", info
    data, last = recorded(out / "run.mcap")
    same(seen, data)
    for topic in WANTED:
        schema, kept = channels[topic], last[topic][0]
        assert schema["schemaName"] == kept.name, topic
        if schema["schemaEncoding"] == "protobuf":
            assert base64.b64decode(schema["schema"]) == kept.data, topic
        else:
            assert schema["schema"].encode() == kept.data, topic
    paths = layout_paths()
    for path in paths:
        assert isinstance(value_at(path, last), (int, float)), path
    count = sum(len(messages) for topic in seen.values() for messages in topic.values())
    truths = len(seen["/world/truth"])
    print(f"live: {count} messages on {len(seen)} topics as in run.mcap, {truths} of "
          f"{len(data['/world/truth'])} world states; {len(paths)} paths of the layout resolve")


if __name__ == "__main__":
    main()
