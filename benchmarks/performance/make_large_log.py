"""Writes a log as large as asked for, in constant memory: a PUMA 560 that moves for hours, as CSV or Parquet.

    python -m benchmarks.performance.make_large_log FILE [--rows 10000000] [--rate 1000] [--seed 1]

Each joint moves along a sum of five sines of its own frequencies (0.1 to 2 Hz, never repeating) in the middle of its range; torque is
that of the built-in robot's nominal parameters with friction on the motor side, with white noise of 2 % of each motor's own torque,
positions come from encoders of 40,000 counts a joint turn. A row takes about 200 to 240 bytes: time, six positions, six motor torques."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

import ident
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values

Array = np.ndarray
_PIECE = 100_000
_SINES = 5
_COUNTS = 40_000


class Puma:
    """Motion and torque at any time."""

    def __init__(self, seed: int) -> None:
        self.robot = ident.load_robot("puma560")
        self.model = self.robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
        self.values = nominal_values(self.model)
        rng = np.random.default_rng(seed)
        lower, upper = (np.array([getattr(j, side) for j in self.robot.joints]) for side in ("lower", "upper"))
        self.centre, half = (lower + upper) / 2, np.minimum((upper - lower) / 2, np.pi)
        self.frequency = 2 * np.pi * np.exp(rng.uniform(np.log(0.1), np.log(2.0), (_SINES, len(half))))
        self.phase = rng.uniform(0, 2 * np.pi, self.frequency.shape)
        # Equal speeds of all sines; together they stay within the range.
        share = 1 / self.frequency
        self.size = 0.9 * half * share / share.sum(axis=0)
        _, _, _, tau = self.motion(np.arange(0.0, 100.0, 0.01))
        self.noise = 0.02 * np.sqrt(np.mean(tau**2, axis=0))

    def motion(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Position, velocity, acceleration and motor torque (N, 6) at times (N,)."""
        q = np.tile(self.centre, (len(t), 1))
        dq, ddq = np.zeros_like(q), np.zeros_like(q)
        for w, a, phase in zip(self.frequency, self.size, self.phase, strict=True):
            angle = np.multiply.outer(t, w) + phase
            sine = a * np.sin(angle)
            q += sine
            dq += a * w * np.cos(angle)
            ddq -= w**2 * sine
        return q, dq, ddq, self.model.inverse_dynamics(q, dq, ddq, self.values)


def write(path: Path, rows: int, rate: float = 1000.0, seed: int = 1) -> None:
    """Write the log piece by piece."""
    puma, rng = Puma(seed), np.random.default_rng(seed + 1)
    n = puma.robot.n
    names = ["t", *(f"q{j + 1}" for j in range(n)), *(f"tau_m{j + 1}" for j in range(n))]
    schema = pa.schema([(name, pa.float64()) for name in names])
    as_csv = path.suffix.lower() == ".csv"
    with csv.CSVWriter(path, schema) if as_csv else parquet.ParquetWriter(path, schema) as writer:
        for first in range(0, rows, _PIECE):
            t = np.arange(first, min(first + _PIECE, rows)) / rate
            q, _, _, tau = puma.motion(t)
            q = np.round(q * _COUNTS / (2 * np.pi)) * (2 * np.pi / _COUNTS)
            tau += puma.noise * rng.standard_normal(tau.shape)
            writer.write_table(pa.table(dict(zip(names, [t, *q.T, *tau.T], strict=True)), schema=schema))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="FILE.csv or FILE.parquet")
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--rate", type=float, default=1000.0, help="Hz")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    write(args.file, args.rows, args.rate, args.seed)
    print(f"{args.file}: {args.rows} rows, {args.file.stat().st_size / 1e9:.3f} GB")


if __name__ == "__main__":
    main()
