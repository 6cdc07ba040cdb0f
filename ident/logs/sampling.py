"""Recordings without a time that tell how often they were sampled: a period (`dt`, `Ts`) or a rate (`fs`), once or in every row."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import DataError
from .languages import in_english
from .source import TableSource
from .time_names import scalar_time_names
from .units import is_unit, split_unit, unit_of

Array = np.ndarray
#: Names of a period and of a rate that columns may have, and those that only a constant may have.
_PERIODS = {
    "dt", "delta_t", "deltat", "delta_time", "time_step", "timestep", "sample_time", "sampling_time", "sample_period", "sampling_period",
    "cycle_time", "step_size", "control_dt", "sim_dt", "control_period",
}  # fmt: skip
_RATES = {"fs", "sample_rate", "samplerate", "sampling_rate", "sampling_frequency", "sample_frequency", "samples_per_second"}
_PERIOD, _RATE = (
    _PERIODS | {"ts", "t_s", "period", "tsample", "delta_x"},
    _RATES | {"f_s", "fps", "rate", "freq", "frequency", "hz", "control_freq"},
)
#: Words that say together how often something was sampled, in English and beside it, and such as one name.
_SAMPLED = {"sample", "samples", "sampling", "sampled", "echantillonnage", "muestreo", "campionamento", "amostragem", "probkowania"}
_KEPT = _SAMPLED | {"recording", "recorded", "logging", "logged", "log", "acquisition"}
_OFTEN = {"rate", "frequency", "freq", "frequenz", "frequence", "frecuencia", "frequenza", "frequencia", "czestotliwosc", "f"}
_APART = {"period", "interval", "time", "step", "zeit", "intervall", "periode", "periodo", "intervalo", "intervallo", "okres"}
_SCRIPTS = {
    "采样频率": "rate", "采样率": "rate", "サンプリング周波数": "rate", "샘플링주파수": "rate", "частота": "rate", "采样周期": "period",
    "采样时间": "period", "采样间隔": "period", "サンプリング周期": "period", "샘플링주기": "period",
}  # fmt: skip
#: Seconds between samples that are no more than this are seconds where no unit is told; two that differ by less are the same.
_LONGEST, _SAME = 0.5, 0.01
#: The column of time that is made of the seconds between rows.
SUMMED = "time_s"


@dataclass(frozen=True)
class Sampling:
    """How often a recording was sampled: `rate_hz`, or a `column` of times since the row before, each `factor` s; `said` of it."""

    rate_hz: float | None = None
    column: str = ""
    factor: float = 1.0
    said: str = ""


def sampling_of(source: TableSource) -> Sampling | None:
    """What a table without a time tells of its sampling; None where nothing does, or a column is one of time.

    Raises DataError where it tells something in a unit that is not known, or two things."""
    names = source.header.names
    columns = [name for name in names if _bare(name)[0] in _PERIODS | _RATES]
    if set(scalar_time_names(names, dict(zip(names, source.header.units, strict=False)))) - set(columns):
        return None
    told = {name: value for name, value in source.constants.items() if _constant(name) and np.isfinite(value) and value > 0}
    rates = {name: _rate(name, value, _constant(name) == "period", source.where) for name, value in told.items()}
    if len(rates) > 1 and max(rates.values()) > (1 + _SAME) * min(rates.values()):
        listed = ", ".join(f"{name} = {told[name]:g}" for name in rates)
        raise DataError(
            f"{source.where}: holds no time, but {listed}, and it is not clear which is that of the samples. Give the sample rate:"
            " [logs] rate_hz = … (--rate-hz)."
        )
    for name, rate in rates.items():
        return Sampling(rate, said=f"{source.where}: holds no time; {name} = {told[name]:g} says {rate:g} samples per second.")
    for name in columns:
        if (found := _by_column(source, name)) is not None:
            return found
    return None


def _by_column(source: TableSource, name: str) -> Sampling | None:
    values = np.asarray(source.read([name], ())[name], float)
    known = values[np.isfinite(values)]
    if len(known) < 2 or (known[1:] <= 0).any() or (np.diff(known) > 0).all():
        return None
    middle = float(np.median(known))
    if _bare(name)[0] in _RATES:
        if np.ptp(known) > _SAME * middle:
            return None
        rate = _rate(name, middle, _bare(name)[0] in _PERIOD, source.where)
        return Sampling(rate, said=f"{source.where}: holds no time; column {name!r} says {rate:g} samples per second.")
    rate = _rate(name, middle, _bare(name)[0] in _PERIOD, source.where)
    return Sampling(None, name, 1.0 / (rate * middle), f"{source.where}: the time is the sum of {name!r}, the time since the previous row.")


def with_summed_time(source: TableSource, found: Sampling) -> TableSource:
    """The table with a column of time that is the sum of the times between its rows."""

    def read(names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
        table = source.read([name for name in names if name != SUMMED], [name for name in optional if name != SUMMED])
        if SUMMED in (*names, *optional):
            steps = np.asarray(source.read([found.column], ())[found.column], float)
            if not np.isfinite(steps[1:]).all():
                raise DataError(f"{source.where}: column {found.column!r} lacks the time since the previous row in some rows.")
            table[SUMMED] = found.factor * np.concatenate([[0.0], np.cumsum(steps[1:])])
        return table

    header = source.header
    units = (*header.units, *("" for _ in header.names[len(header.units) :]), "s") if header.units else ()
    return replace(source, header=replace(header, names=(*header.names, SUMMED), units=units), read=read)


def _bare(name: str) -> tuple[str, str]:
    """The last part of a name in small letters, its words apart, without its unit; and that unit."""
    stem, unit = split_unit(re.sub("kHz", "khz", re.split(r"[./]", name)[-1]))
    bare = re.sub(r"[\s\-]+", "_", re.sub(r"([a-z])([A-Z])", r"\1_\2", stem)).lower().strip("_")
    if bare not in _PERIOD | _RATE and (found := re.fullmatch(r"(.+?)_?\(?\[?(k?)hz\]?\)?", bare)):
        return found[1].strip("_"), f"{found[2]}Hz"
    return bare, unit or ""


def _constant(name: str) -> str:
    """Whether a constant's name is that of a "period" or a "rate"; "" for another."""
    bare, unit = _bare(name)
    if bare in _PERIOD | _RATE:
        return "period" if bare in _PERIOD else "rate"
    plain = re.sub("abtast", "sample ", in_english(name).lower())
    if found := next((kind for word, kind in _SCRIPTS.items() if word in plain.replace(" ", "")), ""):
        return found
    words = set(re.findall(r"[a-z]+", plain))
    timed = bool(unit) and is_unit(unit) and unit_of(unit).dimension == "time"
    if words & _KEPT and not timed and (words & _OFTEN or unit.lower() in ("hz", "khz")):
        return "rate"
    return "period" if words & _SAMPLED and (words & _APART or timed) else ""


def _rate(name: str, value: float, period: bool, where: str) -> float:
    """Samples per second. Raises DataError for a period or a rate whose unit nobody knows."""
    unit = _bare(name)[1]
    if not period:
        rate = 1e3 * value if unit == "kHz" else value
        known = unit != "" or rate >= 1.0
    elif unit and unit_of(unit).dimension == "time":
        return 1.0 / (value * unit_of(unit).scale)
    else:
        rate, known = 1.0 / value, value <= _LONGEST
    if not known:
        usual = 1e3 / value if period else 1e3 * value
        raise DataError(
            f"{where}: holds no time, and {name} = {value:g} gives its sampling in an unknown unit. Give the sample rate:"
            f" [logs] rate_hz = {usual:g} (--rate-hz {usual:g}) if it is in {'ms' if period else 'kHz'}."
        )
    return rate
