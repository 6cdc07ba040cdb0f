"""Kinds of file that are not read: what they are, and what to do."""

from __future__ import annotations

from pathlib import Path

from ...errors import DataError
from .stored import LogFormat, Stored, register_log_format

#: First bytes, kind, remedy.
_KINDS: tuple[tuple[bytes, str, str], ...] = (
    (b"ULog\x01\x12\x35", "a PX4 ULog file", "turn it into CSV with ulog2csv (pip install pyulog), and name the file of the joints"),
    (b"TDSm", "a LabVIEW TDMS file", "save its channels as CSV or Parquet (nptdms: TdmsFile.read(path).as_dataframe())"),
    (b"RRF", "a Rerun recording", "export the joints as a table (rerun's dataframe view as CSV or Parquet)"),
    (b"MDF     ", "a measurement file (MDF)", "export it as MAT, HDF5 or CSV (asammdf: MDF(path).export)"),
    (b"SQLite format 3\x00", "an SQLite data base", "name the folder of a ROS 2 bag; export tables of others as CSV"),
    (b"PK\x03\x04", "", ""),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook (.xls)", "save the sheet as CSV"),
    (b"\x80\x04\x95", "a Python pickle", "opening it may run code; save the table as Parquet, CSV or NPZ"),
    (b"\x80\x05\x95", "a Python pickle", "opening it may run code; save the table as Parquet, CSV or NPZ"),
    (b"\x1f\x8b", "a compressed file without a table in it", "unpack it"),
)


def _zipped(path: Path, start: bytes) -> tuple[str, str]:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        content = start + file.read()
    if b"xl/" in content:
        return "an Excel workbook", "save the sheet as CSV"
    return "a ZIP archive", "decompress it, and give the log in it"


def _kind(path: Path, start: bytes) -> tuple[str, str]:
    for magic, kind, remedy in _KINDS:
        if start.startswith(magic):
            return (kind, remedy) if kind else _zipped(path, start)
    if ".tfrecord" in path.name.lower():
        return "a TFRecord file (RLDS)", "write its steps as Parquet or HDF5 (tfds.load, then a table of the joints' observations)"
    return ("", "")


def _is_one(path: Path, start: bytes) -> bool:
    return path.is_file() and path.suffix.lower() not in (".npz", ".db3", ".mcap", ".bag") and bool(_kind(path, start)[0])


def _read(path: Path) -> Stored:
    with path.open("rb") as file:
        kind, remedy = _kind(path, file.read(512))
    raise DataError(f"log {path}: is {kind}, which is not supported: {remedy}.")


UNREAD = register_log_format(LogFormat("another kind of file", _is_one, _read))
