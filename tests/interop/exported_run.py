"""Exports a run in every format and reads it back with the tools the formats are for.

    python tests/interop/exported_run.py PLATOON RUN.mcap

PLATOON is the command. Needs the Python packages of requirements.txt.

- python-can reads the candump and the ASC log: the same frames in the same order as in the MCAP.
- python-can makes BLF and MF4 of the candump log, and of those a candump log again, as
  docs/traces.md says: each holds the same frames, with the same times, and `platoon import` makes
  a trace with the same frames of it.
- The Parquet and CSV tables of a message have a row for every frame of it, and in each what cantools
  decodes from the frame; the units of the DBC stand in the Parquet schema's metadata, and pandas,
  polars and DuckDB see them there.

Exits with 1 and names what differs, with 2 when something cannot be read.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import can
import cantools
import duckdb
import pandas
import polars
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


def logged(path):
    """The frames of a log by channel, and all times from its first frame on."""
    frames, times_s = {}, []
    for message in can.LogReader(path):
        frame = (message.arbitration_id, bytes(message.data), message.is_fd)
        frames.setdefault(message.channel, []).append(frame)
        times_s.append(message.timestamp)
    return frames, [time_s - times_s[0] for time_s in times_s]


def check_log(path, frames, what):
    """A log holds the frames of every bus in their order."""
    found, _ = logged(path)
    in_order = [found[channel] for channel in sorted(found, key=str)]
    require(in_order == [frames[bus] for bus in sorted(frames)], f"{what}: other frames")
    print(f"{what}: {sum(map(len, in_order))} frames, as recorded")


def convert(log, out):
    """The one line of docs/traces.md."""
    subprocess.run([sys.executable, "-m", "can.logconvert", log, out], check=True)
    return out


def check_converted(platoon, log, ending, frames):
    """Through another format and back nothing changes."""
    binary = convert(log, log.with_suffix(ending))
    check_log(binary, frames, ending)
    times_s, wanted_s = logged(binary)[1], logged(log)[1]
    apart_s = max(abs(ours - theirs) for ours, theirs in zip(times_s, wanted_s, strict=True))
    require(apart_s < 2e-6, f"{ending}: times apart by {apart_s} s")
    back = convert(binary, log.with_name(f"from{ending}.log"))
    trace = back.with_suffix(".mcap")
    subprocess.run([platoon, "import", back, "-o", trace], check=True)
    again, _ = recorded(trace)
    # A bus without frames is none in a log.
    same = [again[bus] for bus in sorted(again)] == [frames[bus] for bus in sorted(frames)]
    require(same, f"{ending}: other frames after import")


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


def check_readers(folder, frames):
    """pandas, polars and DuckDB see the same rows, the same sum, and the unit."""
    path = str(folder / f"bus{max(frames)}.EgoState.parquet")
    total = pandas.read_parquet(path)["PositionX"].sum()
    of_polars = polars.read_parquet(path)["PositionX"].sum()
    of_duckdb = duckdb.sql(f"select sum(PositionX) from '{path}'").fetchall()[0][0]
    for name, found in (("polars", of_polars), ("DuckDB", of_duckdb)):
        require(abs(found - total) <= 1e-9 * abs(total), f"{name}: {found} against {total}")
    unit = "select value from parquet_kv_metadata(?) where key = 'PositionX.unit'"
    ((of_duckdb,),) = duckdb.execute(unit, [path]).fetchall()
    of_polars = polars.read_parquet_metadata(path)["PositionX.unit"]
    require((of_duckdb, of_polars) == (b"m", "m"), f"units: {of_duckdb!r}, {of_polars!r}")
    print("pandas, polars and DuckDB read the same sum, and its unit")


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
        log = export(platoon, run, "candump", folder / "run.log")
        check_log(log, frames, "candump")
        check_log(export(platoon, run, "asc", folder / "run.asc"), frames, "ASC")
        check_converted(platoon, log, ".blf", frames)
        check_converted(platoon, log, ".mf4", frames)
        parquet = export(platoon, run, "parquet", folder / "parquet")
        check_tables(parquet, export(platoon, run, "csv", folder / "csv"), frames, dbc)
        check_readers(parquet, frames)


main()
