"""Runs rehearsals over kernel CAN with the tools of can-utils attached.

    python tests/interop/can_utils_run.py target/debug/platoon FOLDER

To be started as root in a kernel with CAN (`platoon vcan shell` boots one) where interfaces truck0 to
truck3 are nobody else's; they are created when missing. FOLDER takes the traces and logs, for
candump_equals_mcap.py and candump_readers.py. Needs can-utils, iproute2 and the Python packages of
requirements.txt. The acts:

clean    candump logs a rehearsal of 20 s at 100 Hz: no frame is lost between rig and ECUs.
j1939    cansniffer, which knows classic CAN only, canbusload (for canbusload_equals_model.py) and
         candump watch a rehearsal of that profile.
hostile  cansend and canplayer put damaged, shortened and repeated commands and states, and frames
         of strangers, on the buses: rig and ECU refuse and count each, and no truck moves by them.
play     platoon play puts the first seconds of the clean act on the same buses again: candump's log of
         it has the frames of that act, in their order. How well the times between them were kept is
         told, not judged.
player   canplayer plays what the rig sent to truck 1 in the clean act to a lone ECU: it becomes
         ready, runs, ends, and finds nothing wrong.

Exits with 1 and says what did not hold.
"""

import collections
import contextlib
import json
import os
import pathlib
import signal
import statistics
import subprocess
import sys
import time

import cantools
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from candump_equals_mcap import of_candump
from e2e_profile5 import protected

ROOT = pathlib.Path(__file__).resolve().parents[2]
DBC = cantools.database.load_file(str(ROOT / "can-dbc" / "platoon.dbc"))
EGO, ACTUATION, STATUS = map(DBC.get_message_by_name, ["EgoState", "Actuation", "EcuStatus"])
TRUCKS = [f"truck{index}" for index in range(4)]
PATIENCE_S = 120
# A command that no controller asks for: full throttle to the side.
WILD = {"Force": 23456.5, "Steering": 0.31}
AGAIN = 20
# What rig and ECU count that must be zero when nobody disturbs them.
RIG_FAULTS = (
    "bad_crc malformed unknown repeated counter_jumps missing out_of_order out_of_range "
    "receive_failed send_failed not_encodable unechoed unrecorded"
).split()
ECU_FAULTS = "lost repeated crc malformed foreign receive_errors".split()


def require(holds, text):
    if not holds:
        sys.exit(f"can_utils_run: {text}")


def run(*words):
    subprocess.run([str(word) for word in words], check=True, stdin=subprocess.DEVNULL)


def make_interfaces():
    for name in TRUCKS:
        shown = subprocess.run(["ip", "link", "show", name], capture_output=True)
        if shown.returncode != 0:
            run("ip", "link", "add", name, "type", "vcan")
        run("ip", "link", "set", name, "down")
        run("ip", "link", "set", name, "mtu", 72, "up")


@contextlib.contextmanager
def beside(*words, output=subprocess.DEVNULL, cwd=None):
    """Runs a program while the block runs, then interrupts it as Ctrl-C does."""
    program = subprocess.Popen(
        [str(word) for word in words],
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=subprocess.STDOUT,
        cwd=cwd,
    )
    try:
        yield program
    finally:
        program.send_signal(signal.SIGINT)
        program.wait(timeout=PATIENCE_S)


@contextlib.contextmanager
def candump(folder):
    """Logs all buses to one file in the folder; a large buffer, because the run outranks it."""
    folder.mkdir(parents=True)
    with beside("candump", "-r", 16 << 20, "-l", *TRUCKS, cwd=folder) as program:
        # Its sockets are there once the kernel has its receivers.
        table = pathlib.Path("/proc/net/can/rcvlist_all")
        wait_until(lambda: all(name in table.read_text() for name in TRUCKS), "candump listens")
        require(program.poll() is None, "candump ended at once")
        yield
        # What it has not read yet would be lost with its end.
        sizes = [0]
        while len(sizes) < 5 or len(set(sizes[-5:])) > 1:
            time.sleep(0.5)
            sizes.append(log_of(folder).stat().st_size)


def wait_until(holds, what):
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        require(time.monotonic() < deadline, f"waited in vain until {what}")
        time.sleep(0.02)


def log_of(folder):
    (log,) = folder.glob("candump-*.log")
    return log


def logged(folder):
    """Interface and frame of every line of an act's log."""
    with open(log_of(folder), encoding="ascii") as lines:
        return [of_candump(line.rstrip("\n")) for line in lines]


def rehearse(platoon, folder, *words):
    """A rehearsal that has just been started."""
    out = folder / "run"
    with open(folder / "words.txt", "w") as said:
        return subprocess.Popen(
            [platoon, "rehearse", "--bus", "socketcan", "--out", str(out), *map(str, words)],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
        )


def summary_of(rehearsal, folder, duration_s=None):
    """The summary once the rehearsal has ended; a busy machine may fail the behaviour. Without a
    duration it was interrupted."""
    status = rehearsal.wait(timeout=PATIENCE_S + 10 * (duration_s or 0))
    words = (folder / "words.txt").read_text()
    require(status in (0, 1), f"the rehearsal ended with status {status}: {words}")
    summary = json.loads((folder / "run" / "summary.json").read_text())
    ended_s = summary["duration_s"]
    require(duration_s is None or abs(ended_s - duration_s) < 1e-6, f"it ended at {ended_s} s")
    return summary


def require_clean(summary):
    for truck, node in enumerate(summary["nodes"]):
        faults = {fault: node[fault] for fault in RIG_FAULTS if node[fault]}
        require(not faults, f"the rig counted on truck{truck}: {faults}")
        require(node["accepted"] + node["ignored_while_stopping"] > 0, f"no command: {node}")
    require(len(summary["ecus"]) == len(TRUCKS), "an ECU left no report")
    for ecu in summary["ecus"]:
        faults = {fault: ecu["received"][fault] for fault in ECU_FAULTS if ecu["received"][fault]}
        require(not faults, f"ECU {ecu['truck']} counted: {faults}")
        require(ecu["receive_overflow"] == 0, f"ECU {ecu['truck']} read too late: {ecu}")
        require(ecu["dropped_records"] == 0, f"ECU {ecu['truck']} recorded too late: {ecu}")


def act_clean(platoon, folder):
    with candump(folder):
        rehearsal = rehearse(platoon, folder, "--rate-hz", 100, "--duration-s", 20)
        summary = summary_of(rehearsal, folder, 20)
    require_clean(summary)
    print(f"clean: {len(logged(folder))} frames in candump's log, none lost by any counter")


def act_j1939(platoon, folder):
    drawn, load = folder / "cansniffer.txt", folder / "canbusload.txt"
    # Above the run, because its buffer is small; and its last second must have passed.
    rates = [f"{name}@500000" for name in TRUCKS]
    meter = ("chrt", "--fifo", 95, "canbusload", "-e", *rates)
    with candump(folder), open(drawn, "wb") as screen, open(load, "wb") as table:
        with beside("cansniffer", "truck1", output=screen), beside(*meter, output=table):
            rehearsal = rehearse(platoon, folder, "--profile", "j1939", "--duration-s", 10)
            summary = summary_of(rehearsal, folder, 10)
            time.sleep(2)
    require_clean(summary)
    sent = {frame.id for interface, frame in logged(folder) if interface == "truck1"}
    text = drawn.read_text(errors="replace")
    # It redraws five times a second, and forgets what is silent for five seconds.
    missing = [f"{identifier:08X}" for identifier in sent if f"| {identifier:08X} |" not in text]
    require(not missing, f"cansniffer did not show {missing}")
    print(f"j1939: cansniffer showed all {len(sent)} identifiers of truck1")


def be_urgent():
    """Outranks rig and ECUs where that is allowed; a slow machine would send nothing in time."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(90))


def cansend(interface, identifier, data, fd=True):
    """The line of a shell that sends a frame."""
    return f"cansend {interface} {identifier:08X}#{'#1' if fd else ''}{data.hex()}"


def attack(folder, interface, message, signals):
    """Lines of a shell: three frames with a wrong CRC, two malformed ones, and one sent again and
    again with nothing between."""
    zeros = {s.name: 0 for s in message.signals if not s.name.startswith("E2e")}
    sound = [protected(message, {**zeros, **signals}, counter) for counter in range(4)]
    again = folder / f"again-{interface}.log"
    line = f"(0.000000) {interface} {message.frame_id:08X}##1{sound[3].hex().upper()}\n"
    again.write_text(line * AGAIN)
    damaged = [bytes([data[0] ^ 0x55]) + data[1:] for data in sound[:3]]
    return [
        *(cansend(interface, message.frame_id, data) for data in damaged),
        cansend(interface, message.frame_id, sound[3][:12]),
        cansend(interface, message.frame_id, sound[3][:8], fd=False),
        f"canplayer -t -I {again} {interface}={interface}",
    ]


def await_answers():
    """Returns once every truck has had some more commands of its ECU."""
    for name in TRUCKS:
        answers = f"{name},{ACTUATION.frame_id:X}:1FFFFFFF"
        subprocess.run(
            ["candump", "-n", "5", answers], timeout=PATIENCE_S, check=True, capture_output=True
        )


def wild_commands(trace):
    """How often the true world knew the command of the attack."""
    found = collections.Counter()
    with open(trace, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for *_, truth in reader.iter_decoded_messages(topics=["/world/truth"]):
            for index, truck in enumerate(truth.trucks):
                force = abs(truck.force_command_n - WILD["Force"]) < 1
                steering = abs(truck.steering_command_rad - WILD["Steering"]) < 1e-3
                found[index] += force or steering
    return found


def act_hostile(platoon, folder):
    with candump(folder):
        lines = [
            *attack(folder, "truck1", ACTUATION, WILD),
            *attack(folder, "truck2", EGO, {"SpeedForward": 5.0}),
            cansend("truck3", 0x1ABCDEF0, b"\xde\xad\xbe\xef", fd=False),
            "cansend truck3 123#R",
        ]
        (folder / "attack.sh").write_text("\n".join(lines))
        # However slow the machine, the run outlasts the attack: it ends when that is over.
        rehearsal = rehearse(platoon, folder, "--rate-hz", 100)
        await_answers()
        subprocess.run(["sh", "-e", folder / "attack.sh"], check=True, preexec_fn=be_urgent)
        await_answers()
        rehearsal.send_signal(signal.SIGINT)
        summary = summary_of(rehearsal, folder)
    node, ecu = summary["nodes"], {ecu["truck"]: ecu["received"] for ecu in summary["ecus"]}
    rig = node[1]
    require(rig["bad_crc"] == 3 and rig["malformed"] == 2, f"commands, wrong: {rig}")
    # The first is new by its counter; a truck that is stopping ignores it whatever it asks for.
    old = rig["repeated"] + rig["out_of_order"] + rig["ignored_while_stopping"]
    require(old >= AGAIN, f"commands, repeated: {rig}")
    require(rig["repeated"] > AGAIN / 2, f"commands, repeated: {rig}")
    require(ecu[2]["crc"] == 3 and ecu[2]["malformed"] == 2, f"states, wrong: {ecu[2]}")
    require(ecu[2]["repeated"] + ecu[2]["outdated"] >= AGAIN, f"states, repeated: {ecu[2]}")
    require(ecu[2]["repeated"] > AGAIN / 2, f"states, repeated: {ecu[2]}")
    require(node[3]["unknown"] == 2 and ecu[3]["foreign"] == 2, f"strangers: {node[3]} {ecu[3]}")
    for truck in (0, 3):
        require(node[truck]["bad_crc"] == 0, f"damage on the wrong bus: {node[truck]}")
    wild = wild_commands(folder / "run" / "run.mcap")
    require(not any(wild.values()), f"a truck obeyed the attack: {wild}")
    print(
        f"hostile: the rig refused {rig['bad_crc']} CRCs, {rig['malformed']} malformed and "
        f"{rig['repeated'] + rig['out_of_order']} replayed commands, ECU 2 {ecu[2]['crc']}, "
        f"{ecu[2]['malformed']} and {ecu[2]['repeated'] + ecu[2]['outdated']} states"
    )


def commands(frames):
    """Force and steering by the tick they answer."""
    answers = [ACTUATION.decode(frame.data) for frame in frames if frame.id == ACTUATION.frame_id]
    return {a["AnswersTick"]: (a["Force"], a["Steering"]) for a in answers}


def gaps_wrong_us(again, first):
    """By how much the time since the frame before on the same bus was another."""
    def gaps(frames):
        return [after.time_us - before.time_us for before, after in zip(frames, frames[1:])]

    return [abs(ours - theirs) for ours, theirs in zip(gaps(again), gaps(first))]


def act_play(platoon, folder, source):
    told = folder / "play.json"
    with candump(folder):
        words = "--bus socketcan --until 5 --json".split()
        run(platoon, "play", source / "run" / "run.mcap", *words, told)
    played = json.loads(told.read_text())
    require(played["refused"] == 0, f"the bus refused frames: {played}")
    ours, theirs = collections.defaultdict(list), collections.defaultdict(list)
    for frames, act in ((ours, folder), (theirs, source)):
        for interface, frame in logged(act):
            frames[interface].append(frame)
    wrong_us = []
    for name in TRUCKS:
        first = theirs[name][: len(ours[name])]
        same = [f._replace(time_us=0) for f in ours[name]] == [f._replace(time_us=0) for f in first]
        require(ours[name] and same, f"{name}: other frames than in the clean act")
        wrong_us += gaps_wrong_us(ours[name], first)
    count = sum(map(len, ours.values()))
    require(count == played["frames"], f"{count} frames in the log, {played['frames']} played")
    p99_us = statistics.quantiles(wrong_us, n=100)[98]
    print(
        f"play: {count} frames on four buses as in the clean act; gaps wrong by p99 {p99_us:.0f} µs "
        f"on the bus, {played['between_us']['p99']:.0f} µs at the player, where the machine alone "
        f"was late by {played['machine_floor_us']['p99']:.0f} µs: "
        f"{played['net_of_floor_us']['between_p99']:.0f} µs net"
    )


def act_player(platoon, folder, source):
    """What the rig sent to truck 1 is what has its source address, 0x80."""
    folder.mkdir(parents=True)
    heard = folder / "rig.log"
    lines = log_of(source).read_text().splitlines(keepends=True)
    of_rig = [line for line in lines if line.split()[1:2] == ["truck1"]]
    of_rig = [line for line in of_rig if line.split()[2][6:8] == "80"]
    heard.write_text("".join(of_rig))
    with candump(folder / "log"):
        words = "controller --truck 1 --bus socketcan --interfaces truck1 --out".split()
        ecu = subprocess.Popen(
            [platoon, *words, str(folder)], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(2)
        run("canplayer", "-g", 1, "-I", heard, "truck1=truck1")
        require(ecu.wait(timeout=PATIENCE_S) == 0, "the ECU failed")
    report = json.loads((folder / "ecu1.json").read_text())
    received = report["received"]
    faults = {fault: received[fault] for fault in ECU_FAULTS if received[fault]}
    require(not faults, f"the lone ECU counted {faults}")
    require(report["ending"] == "mission_ended", f"it ended by {report['ending']}")
    # After the first of three farewells it is gone.
    require(received["used"] + received["parts"] >= len(of_rig) - 2, f"it heard {received}")
    ours = commands(frame for _, frame in logged(folder / "log"))
    theirs = commands(frame for name, frame in logged(source) if name == "truck1")
    both = sorted(ours.keys() & theirs.keys())
    require(both, "no tick was answered in both runs")
    apart = [abs(ours[tick][0] - theirs[tick][0]) for tick in both]
    same = sum(ours[tick] == theirs[tick] for tick in both)
    print(
        f"player: {len(of_rig)} frames, {report['ticks']} ticks, nothing wrong; of {len(both)} ticks "
        f"answered in both runs {same} commands are the same, force apart {statistics.median(apart):.1f} N "
        "in the median"
    )


def main(platoon, folder):
    platoon, folder = str(pathlib.Path(platoon).resolve()), pathlib.Path(folder).resolve()
    make_interfaces()
    act_clean(platoon, folder / "clean")
    act_play(platoon, folder / "play", folder / "clean")
    act_hostile(platoon, folder / "hostile")
    act_player(platoon, folder / "player", folder / "clean")
    act_j1939(platoon, folder / "j1939")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
