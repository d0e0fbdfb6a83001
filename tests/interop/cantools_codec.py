"""Holds our codec against cantools: the same bytes both ways, for random messages of every type.

    python tests/interop/cantools_codec.py target/debug/examples/codec_vectors [COUNT] [SEED]

COUNT messages of each type of platoon.dbc and of j1939.dbc, error and not-available codes among
them. Exits 1 at the first mismatch, and says which message with which values.
"""

import logging
import pathlib
import random
import re
import subprocess
import sys
import warnings

import cantools

import e2e_profile5
import j1939_checksums
from j1939_codes import codes, is_described, meaning

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "can-dbc"
CHECKSUMS = ("E2eCrc", "MessageChecksum")
COUNTERS = ("E2eCounter", "MessageCounter")
# Our names end in these, by unit.
SUFFIXES = {
    None: "", "m": "_m", "m/s": "_mps", "m/s2": "_mps2", "rad": "_rad", "rad/s": "_radps", "N": "_n",
    "s": "_s", "ns": "_ns", "%": "_percent", "km/h": "_kmph", "rpm": "_rpm",
}  # fmt: skip


def load(path):
    """Loads a DBC; anything cantools grumbles about is a failure."""
    grumbles = []
    handler = logging.Handler()
    handler.emit = lambda record: grumbles.append(record.getMessage())
    logging.getLogger("cantools").addHandler(handler)
    warnings.simplefilter("error")
    database = cantools.database.load_file(str(path), strict=True)
    if grumbles:
        sys.exit(f"cantools on {path.name}: {grumbles}")
    return database


def is_j1939(message):
    return message.protocol == "j1939"


def random_value(signal, dice):
    """A code, on the grid, off the grid, exactly between two steps, or at a limit."""
    if is_described(signal):
        return dice.choice(list(signal.choices))
    if codes(signal) and dice.random() < 0.2:
        return dice.choice(list(codes(signal)))
    scale, offset = signal.conversion.scale, signal.conversion.offset
    low = round((signal.minimum - offset) / scale)
    high = round((signal.maximum - offset) / scale)
    raw = dice.choice([low, high]) if dice.random() < 0.1 else dice.randint(low, high)
    if scale == 1 and offset == 0:
        return raw
    kind = dice.random()
    if kind < 0.4:
        value = raw * scale + offset
    elif kind < 0.5:
        value = (raw + 0.5) * scale + offset
    else:
        value = dice.uniform(signal.minimum, signal.maximum)
    return min(max(value, signal.minimum), signal.maximum)


def random_signals(message, dice):
    page = None
    signals = {}
    for signal in message.signals:
        if signal.name in CHECKSUMS:
            continue
        if signal.is_multiplexer:
            page = dice.randint(int(signal.minimum), int(signal.maximum))
            signals[signal.name] = page
        elif signal.multiplexer_ids is None or page in signal.multiplexer_ids:
            signals[signal.name] = random_value(signal, dice)
    return signals


def expected_bytes(message, signals):
    """What cantools makes of it, with the checksum of the published formula."""
    raw = {
        name: str(value).replace("_", " ") if isinstance(value, str) else value
        for name, value in signals.items()
    }
    if is_j1939(message):
        return j1939_checksums.protected(message, raw)
    counter = raw.pop("E2eCounter")
    return e2e_profile5.protected(message, raw, counter)


def ask(binary, questions):
    run = subprocess.run(
        [binary], input="\n".join(questions) + "\n", capture_output=True, text=True, timeout=300
    )
    answers = run.stdout.splitlines()
    if run.returncode or len(answers) != len(questions):
        sys.exit(f"{binary}: exit {run.returncode}, {len(answers)} answers: {run.stderr}")
    return answers


def check_encoding(binary, cases):
    def line(message, signals):
        values = (
            f"{name}={value if isinstance(value, str) else repr(value)}"
            for name, value in signals.items()
        )
        return f"encode {message.name} {' '.join(values)}"

    answers = ask(binary, [line(*case) for case in cases])
    frames = []
    for (message, signals), answer in zip(cases, answers):
        expected = expected_bytes(message, signals)
        if answer != f"{message.frame_id:08X} {expected.hex().upper()}":
            sys.exit(
                f"{message.name} {signals}\n  ours:     {answer}\n  cantools: {expected.hex()}"
            )
        frames.append((message, expected))
    return frames


def field_name(signal):
    """Our field for a signal: PositionX_3 of page 3 is position_x_m, Speed_3 on no page is
    member 3 of the array speed_mps."""
    base, _, number = signal.name.partition("_")
    snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", base).lower()
    member = f"[{number}]" if number and not signal.multiplexer_ids else ""
    return snake + SUFFIXES[signal.unit] + member


def struct_fields(text):
    """Fields of a struct as Rust prints it, members of arrays one by one."""
    array = re.compile(r"(\w+): \[([^]]*)\]")
    fields = {
        f"{name}[{index}]": value
        for name, values in array.findall(text)
        for index, value in enumerate(values.split(", "))
    }
    fields |= re.findall(r"(\w+): (Value\([^)]*\)|[^ ,}]+)", array.sub("", text))
    return fields


def field_text(signal, raw, value):
    """How Rust prints a field of this value."""
    word = meaning(signal, raw)
    if is_described(signal):
        words = re.split(r"[ _-]", str(signal.choices[raw]))
        return "".join(word[:1].upper() + word[1:] for word in words)
    if codes(signal):
        return {"error": "Error", "not_available": "NotAvailable"}.get(word) or f"Value({value})"
    return str(value)


def same(ours, expected):
    """Equal as text or as numbers: 1e-05 is 0.00001."""
    number = re.compile(r"(Value\()?([-+0-9.e]+)\)?")
    both = [number.fullmatch(text) for text in (ours, expected)]
    if not all(both):
        return ours == expected
    return both[0][1] == both[1][1] and float(both[0][2]) == float(both[1][2])


def check_frame(message, data, answer):
    """Signals as cantools decodes them, and each in its field of our struct."""
    listed, _, fields = answer.partition(" | ")
    name, *values = listed.split(" ")
    ours = dict(value.split("=") for value in values)
    theirs = message.decode(data, decode_choices=False)
    raws = message.decode(data, decode_choices=False, scaling=False)
    if name != message.name or set(ours) != set(theirs):
        return f"ours {answer}"
    fields = struct_fields(fields)
    for signal in (s for s in message.signals if s.name in theirs):
        value, raw = theirs[signal.name], raws[signal.name]
        expected = meaning(signal, raw)
        if ours[signal.name] != expected and (expected or float(ours[signal.name]) != value):
            return f"{signal.name}: ours {ours[signal.name]}, cantools {expected or value}"
        if signal.name in CHECKSUMS + COUNTERS:
            continue
        if signal.is_multiplexer:
            field = signal.name.removeprefix(message.name).lower()
        else:
            field = field_name(signal)
        if not same(fields.pop(field, "missing"), field_text(signal, raw, value)):
            return f"field {field} of {answer}, cantools {value}"
    return f"fields {fields} of no signal" if fields else None


def check_decoding(binary, frames):
    answers = ask(
        binary, [f"decode {message.frame_id:08X} {data.hex()}" for message, data in frames]
    )
    for (message, data), answer in zip(frames, answers):
        fault = check_frame(message, data, answer)
        if fault:
            sys.exit(f"{message.name} {data.hex()}: {fault}")


def check_refusals(binary, fd, j1939):
    """Out of range by one step, no number, damaged, of no meaning: refused, never clipped."""
    force = "encode Actuation AnswersTick=1 Steering=0 ActuationStatus=0 Force="
    actuation = {"E2eCounter": 0, "AnswersTick": 1, "Force": 0, "Steering": 0, "ActuationStatus": 0}
    brake = {"AccelerationDemand": -1.0, "EnduranceBrakeMode": 0, "XbrPriority": 3}
    brake |= {"XbrControlMode": 2, "Urgency": "error", "MessageCounter": 9}
    questions = [force + "838860.8", force + "NaN", force + "inf", force + "not_available"]
    questions += ["encode XBR AccelerationDemand=16", "encode TSC1 MessageCounter=8"]
    questions += ["encode TSC1 RequestedTorqueFraction=error"]
    for database, name, signals in ((fd, "Actuation", actuation), (j1939, "XBR", brake)):
        message = database.get_message_by_name(name)
        good = expected_bytes(message, signals)
        for damaged in (good[:5] + bytes([good[5] ^ 1]) + good[6:], good[:-1]):
            questions.append(f"decode {message.frame_id:08X} {damaged.hex()}")
    for question, answer in zip(questions, ask(binary, questions)):
        if not answer.startswith("refused "):
            sys.exit(f"{question}\n  ours: {answer}, expected a refusal")


def check_own_checksums():
    if e2e_profile5.crc16(bytes(6) + (0x1234).to_bytes(2, "little")) != 0xCA1C:
        sys.exit("the CRC of this script does not give the specification's example")
    if j1939_checksums.crc8(b"123456789") != 0x4B:
        sys.exit("the CRC-8 of this script does not give its catalogue's check value")


def main():
    binary = sys.argv[1]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
    dice = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 20261122)
    check_own_checksums()
    fd, j1939 = load(FOLDER / "platoon.dbc"), load(FOLDER / "j1939.dbc")
    messages = fd.messages + j1939.messages
    for message in messages:
        cases = [(message, random_signals(message, dice)) for _ in range(count)]
        check_decoding(binary, check_encoding(binary, cases))
    check_refusals(binary, fd, j1939)
    print(
        f"{count} messages of each of {len(messages)} types: the same bytes as cantools "
        f"{cantools.__version__}, both ways"
    )


if __name__ == "__main__":
    main()
