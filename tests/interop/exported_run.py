"""Exports a run in every format and reads it back with the tools the formats are for.

    python tests/interop/exported_run.py PLATOON RUN.mcap

PLATOON is the command. Needs the Python packages python-can, cantools, mcap, mcap-ros2-support,
pandas and pyarrow; polars and duckdb read the Parquet tables, too, where they are installed, and it
is said when they are not.

- python-can reads the candump and the ASC log: the same frames in the same order as in the MCAP.
- The Parquet and CSV tables of a message have a row for every frame of it, and in each what cantools
  decodes from the frame; the units of the DBC stand in the Parquet schema's metadata.

Exits with 1 and names what differs, with 2 when something cannot be read.
"""

import importlib.util
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import can
import cantools
import pandas
import pyarrow.parquet
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

# Messages compared value by value: one plain, one multiplexed.
MESSAGES = ["EgoState", "Obstacle"]


def require(condition, what):
    """Ends with 1 when something is not as it must be."""
    if not condition:
        print(f"FAILED: {what}")
        sys.exit(1)


def recorded(run):
    """The frames of every bus by bus, and the attached DBC."""
    frames, dbc = {}, None
    with open(run, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for attachment in reader.iter_attachments():
            if attachment.name.endswith(".dbc"):
                dbc = cantools.database.load_string(attachment.data.decode(), "dbc")
        topics = [f"/can/bus{bus}/frames" for bus in range(16)]
        for _, channel, _, frame in reader.iter_decoded_messages(topics=topics):
            bus = int(channel.topic[len("/can/bus") : -len("/frames")])
            frames.setdefault(bus, []).append((frame.id, bytes(frame.data), frame.is_fd))
    return frames, dbc


def export(platoon, run, form, out):
    """Runs `platoon export`."""
    subprocess.run([platoon, "export", run, "--to", form, "-o", out], check=True)
    return out


def check_log(path, frames, what):
    """A log holds the frames of every bus in their order."""
    logged = {}
    for message in can.LogReader(path):
        frame = (message.arbitration_id, bytes(message.data), message.is_fd)
        logged.setdefault(message.channel, []).append(frame)
    in_order = [logged[channel] for channel in sorted(logged, key=str)]
    require(in_order == [frames[bus] for bus in sorted(frames)], f"{what}: other frames")
    print(f"{what}: {sum(map(len, in_order))} frames, as recorded")


def check_tables(folder, tables, frames, dbc):
    """The tables of both kinds say what cantools says."""
    bus = max(frames)
    for name in MESSAGES:
        message = dbc.get_message_by_name(name)
        stem = f"bus{bus}.{name}"
        wanted = [data for id_, data, _ in frames[bus] if id_ == message.frame_id]
        parquet = pandas.read_parquet(folder / f"{stem}.parquet")
        csv = pandas.read_csv(tables / f"{stem}.csv")
        csv.columns = [column.split(" [")[0] for column in csv.columns]
        require(len(parquet) == len(csv) == len(wanted), f"{stem}: {len(parquet)} rows")
        schema = pyarrow.parquet.read_schema(folder / f"{stem}.parquet").metadata
        for signal in message.signals:
            unit = schema.get(f"{signal.name}.unit".encode(), b"").decode()
            require(unit == (signal.unit or ""), f"{stem}.{signal.name}: unit {unit!r}")
        names = [signal.name for signal in message.signals]
        columns = {signal: [table[signal].tolist() for table in (parquet, csv)] for signal in names}
        for row, data in enumerate(wanted):
            decoded = message.decode(data, decode_choices=False)
            for signal in message.signals:
                for column in columns[signal.name]:
                    value, there = column[row], decoded.get(signal.name)
                    same = math.isnan(value) if there is None else value == float(there)
                    require(same, f"{stem} row {row}: {signal.name} {value}, cantools {there}")
        print(f"{stem}: {len(wanted)} rows in CSV and Parquet, as cantools decodes them")


def check_other_readers(folder, frames):
    """polars and DuckDB see the same rows and the same sum."""
    path = str(folder / f"bus{max(frames)}.EgoState.parquet")
    total = pandas.read_parquet(path)["PositionX"].sum()
    for name in ("polars", "duckdb"):
        if importlib.util.find_spec(name) is None:
            print(f"left out: {name} is not installed")
            continue
        if name == "polars":
            import polars

            found = polars.read_parquet(path)["PositionX"].sum()
        else:
            import duckdb

            found = duckdb.sql(f"select sum(PositionX) from '{path}'").fetchall()[0][0]
        require(abs(found - total) <= 1e-9 * abs(total), f"{name}: {found} against {total}")
        print(f"{name} reads it, too")


def main():
    """Checks one run."""
    if len(sys.argv) != 3:
        print(__doc__)
        sys.exit(2)
    platoon, run = sys.argv[1:]
    frames, dbc = recorded(run)
    require(frames and dbc, "no frame or no DBC in the run")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        check_log(export(platoon, run, "candump", folder / "run.log"), frames, "candump")
        check_log(export(platoon, run, "asc", folder / "run.asc"), frames, "ASC")
        parquet = export(platoon, run, "parquet", folder / "parquet")
        check_tables(parquet, export(platoon, run, "csv", folder / "csv"), frames, dbc)
        check_other_readers(parquet, frames)


main()
