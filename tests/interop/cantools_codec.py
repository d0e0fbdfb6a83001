"""Holds our codec against cantools: the same bytes both ways, for 10,000 random messages.

    python tests/interop/cantools_codec.py target/debug/examples/codec_vectors [COUNT] [SEED]

Exits 1 at the first mismatch, and says which message with which values.
"""

import logging
import pathlib
import random
import subprocess
import sys
import warnings

import cantools

from e2e_profile5 import crc16, protected

DBC = pathlib.Path(__file__).resolve().parents[2] / "can-dbc" / "platoon.dbc"


def load(path):
    """Loads the DBC; anything cantools grumbles about is a failure."""
    grumbles = []
    handler = logging.Handler()
    handler.emit = lambda record: grumbles.append(record.getMessage())
    logging.getLogger("cantools").addHandler(handler)
    warnings.simplefilter("error")
    database = cantools.database.load_file(str(path), strict=True)
    if grumbles:
        sys.exit(f"cantools on {path.name}: {grumbles}")
    return database


def random_value(signal, dice):
    """On the grid, off the grid, exactly between two steps, or at a limit."""
    if signal.choices:
        return dice.choice(list(signal.choices))
    scale = signal.conversion.scale
    low, high = round(signal.minimum / scale), round(signal.maximum / scale)
    raw = dice.choice([low, high, 0]) if dice.random() < 0.1 else dice.randint(low, high)
    raw = min(max(raw, low), high)
    if scale == 1:
        return raw
    kind = dice.random()
    if kind < 0.4:
        value = raw * scale
    elif kind < 0.5:
        value = (raw + 0.5) * scale
    else:
        value = dice.uniform(signal.minimum, signal.maximum)
    return min(max(value, signal.minimum), signal.maximum)


def random_message(database, dice):
    message = dice.choice(database.messages)
    page = None
    signals = {}
    for signal in message.signals:
        if signal.name.startswith("E2e"):
            continue
        if signal.is_multiplexer:
            page = dice.randint(int(signal.minimum), int(signal.maximum))
            signals[signal.name] = page
        elif signal.multiplexer_ids is None or page in signal.multiplexer_ids:
            signals[signal.name] = random_value(signal, dice)
    return message, signals


def ask(binary, questions):
    run = subprocess.run(
        [binary], input="\n".join(questions) + "\n", capture_output=True, text=True, timeout=300
    )
    answers = run.stdout.splitlines()
    if run.returncode or len(answers) != len(questions):
        sys.exit(f"{binary}: exit {run.returncode}, {len(answers)} answers: {run.stderr}")
    return answers


def check_encoding(binary, cases):
    def line(message, signals, counter):
        values = " ".join(f"{name}={value!r}" for name, value in signals.items())
        return f"encode {message.name} {counter} {values}"

    answers = ask(binary, [line(*case) for case in cases])
    frames = []
    for (message, signals, counter), answer in zip(cases, answers):
        expected = protected(message, signals, counter)
        if answer != f"{message.frame_id:08X} {expected.hex().upper()}":
            sys.exit(
                f"{message.name} {signals}\n  ours:     {answer}\n  cantools: {expected.hex()}"
            )
        frames.append((message, expected))
    return frames


def check_decoding(binary, frames):
    answers = ask(
        binary, [f"decode {message.frame_id:08X} {data.hex()}" for message, data in frames]
    )
    for (message, data), answer in zip(frames, answers):
        name, counter, *values = answer.split(" ")
        if name != message.name:
            sys.exit(f"{message.name} {data.hex()}: {answer}")
        ours = {signal: float(value) for signal, value in (v.split("=") for v in values)}
        theirs = message.decode(data, decode_choices=False)
        if ours != theirs or int(counter) != theirs["E2eCounter"]:
            sys.exit(f"{message.name} {data.hex()}\n  ours:     {ours}\n  cantools: {theirs}")


def check_refusals(binary, database):
    """Out of range by one step, no number, damaged: refused, never clipped."""
    force = "encode Actuation 0 AnswersTick=1 Steering=0 ActuationStatus=0 Force="
    good = protected(
        database.get_message_by_name("Actuation"),
        {"AnswersTick": 1, "Force": 0, "Steering": 0, "ActuationStatus": 0},
        0,
    )
    damaged = good[:5] + bytes([good[5] ^ 1]) + good[6:]
    questions = [force + "838860.8", force + "NaN", force + "inf", f"decode 18FF112A {damaged.hex()}"]
    for question, answer in zip(questions, ask(binary, questions)):
        if not answer.startswith("refused "):
            sys.exit(f"{question}\n  ours: {answer}, expected a refusal")


def main():
    binary = sys.argv[1]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
    dice = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 20261122)
    if crc16(bytes(6) + (0x1234).to_bytes(2, "little")) != 0xCA1C:
        sys.exit("the CRC of this script does not give the specification's example")
    database = load(DBC)
    cases = [(*random_message(database, dice), dice.randrange(256)) for _ in range(count)]
    frames = check_encoding(binary, cases)
    check_decoding(binary, frames)
    check_refusals(binary, database)
    print(f"{count} messages: the same bytes as cantools {cantools.__version__}, both ways")


if __name__ == "__main__":
    main()
