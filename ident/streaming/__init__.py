"""Logs larger than memory: read once into files, prepared and reduced piece by piece, with the numbers of the way in memory.

    read (tables, text, digest, ingest) -> runs on disk (stored, runs) -> derivatives by pieces (motion) -> what the whole log decides
    (decisions) -> rows and their columns on disk (columns, rows) -> `Signals` that any streaming estimator takes (signals)

What is in memory: a few pieces of 16,384 samples or more, and the torque and masks of the rows (decimated). What is on disk: the log as
numbers of 8 bytes, and the rows' columns. Each piece is a pure function of the log and the decisions, so pieces can be made by
threads or by other machines (`distributed`), and work that was cut off can be taken up again (`checkpoint`)."""

from __future__ import annotations

from .session import THRESHOLD, StreamedSession
from .signals import StreamedSignals, Streaming
from .workers import Threads, Workers

__all__ = ["THRESHOLD", "StreamedSession", "StreamedSignals", "Streaming", "Threads", "Workers"]
