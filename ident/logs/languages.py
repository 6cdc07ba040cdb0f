"""Words of other languages and scripts in the names of columns, as the English ones that are known (words.py)."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

#: English word → what other languages write for it. Latin letters stand without their accents.
_LATIN = {
    "position": "weg verfahrweg pozicio pozitie posisi polozaj asento "
    "posicion posicao posizione positie polozenie pozycja poloha konum stellung lage laege",
    "angle": "winkel angolo angulo hoek kat uhel aci vinkel kulma szog unghi sudut kut ugao kampas",
    "velocity": "sebesseg szogsebesseg viteza kecepatan brzina vinkelhastighet winkelgeschwindigkeit "
    "vitesse velocidad velocidade velocita geschwindigkeit drehzahl snelheid predkosc rychlost hiz hastighet hastighed nopeus",
    "acceleration": "beschleunigung accelerazione aceleracion aceleracao versnelling przyspieszenie zrychleni ivme",
    "torque": "drehmoment couple coppia koppel tork momento moment vaantomomentti nyomatek forgatonyomatek cuplu torsi par",
    "force": "kraft forza fuerza forca kracht sila kuvvet voima ero forta gaya",
    "current": "strom courant corrente corriente stroom prad proud akim virta aram curent arus struja",
    "time": "zeit temps tiempo tempo tijd czas cas zaman tid aika ido timp waktu vrijeme vreme laikas",
    "desired": "soll consigne consigna wunsch deseado deseada desejado desejada desiderato desiderata gewenst zadana zadane hedef",
    "axis": "achse axe eje eixo asse",
    "measured": "ist gemessen mesure mesuree medido medida misurato misurata gemeten zmierzona zmierzone olculen",
    "error": "fehler erreur errore erro fout blad chyba hata fel",
    "temperature": "temperatur temperatura temperatuur teplota sicaklik lampotila",
    "voltage": "spannung tensione tension tensao spanning napiecie napeti",
    "estimated": "geschaetzt estime estimee stimato stimata estimado estimada geschat",
}  # fmt: skip
#: Scripts that do not part their words; of Cyrillic the beginning of words, which end otherwise in every case.
_SCRIPTS = {
    "position": "位置 위치 положени позици",
    "angle": "关节角 角度 関節角 각도 угол угл",
    "velocity": "角速度 速度 转速 각속도 속도 скорост",
    "acceleration": "角加速度 加速度 가속도 ускорени",
    "torque": "力矩 扭矩 转矩 轉矩 トルク 토크 момент",
    "force": "推力 усили",
    "current": "电流 電流 전류 ток",
    "time": "时间 時間 時刻 时刻 时间戳 시간 врем",
    "desired": "目标 目標 期望 指令 参考 給定 给定 목표 지령 명령 задан уставк",
    "measured": "实际 實際 实测 反馈 実測 測定 실제 측정 измер",
    "error": "误差 誤差 偏差 오차 ошибк",
    "temperature": "温度 溫度 온도 температур",
    "voltage": "电压 電圧 電壓 전압 напряжени",
    "estimated": "估计 推定 추정 оценк",
    "external": "外力 外部 외력 внешн",
    "gravity": "重力 중력",
    "feedforward": "前馈 フィードフォワード 피드포워드",
    "motor": "电机 電機 モータ モーター 모터 двигател",
    "tool": "末端 手先 工具 엔드",
}  # fmt: skip
#: Greek words, in which a letter is no symbol.
_GREEK_WORDS = {
    "θέση": "position", "γωνία": "angle", "ταχύτητα": "velocity", "ροπή": "torque", "δύναμη": "force", "ρεύμα": "current",
    "χρόνος": "time", "άξονας": "axis", "άρθρωση": "joint",
}  # fmt: skip
_ENGLISH = {word: english for english, words in _LATIN.items() for word in words.split()}
_PARTS = {word: english for english, words in _SCRIPTS.items() for word in words.split()}
_PART = re.compile("|".join(f"{word}[а-яё]*" if re.match("[а-я]", word) else word for word in sorted(_PARTS, key=len, reverse=True)))
#: Symbols of angles, torques and their rates.
_GREEK = str.maketrans({"τ": "tau", "θ": "theta", "ϑ": "theta", "ω": "omega"})
_DOTS = re.compile("([qxθϑφϕ])([\u0307\u0308])")
#: Letters of Latin scripts that are none with an accent.
_LETTERS = str.maketrans({"ł": "l", "ı": "i", "ø": "o", "đ": "d", "æ": "ae", "ß": "ss"})


@lru_cache(maxsize=4096)
def in_english(name: str) -> str:
    """A name in small letters, with words of other scripts as English ones, and Latin letters without their accents.

    Examples
    --------
    >>> in_english("Posição 2"), in_english("关节1力矩")
    ('posicao 2', '关节1 torque ')
    """
    if name.isascii():
        return name
    for word, said in _GREEK_WORDS.items():
        name = name.replace(word, f" {said} ")
    name = _with_dots(name).translate(_GREEK)
    plain = "".join(_bare(letter) for letter in name.translate(_LETTERS))
    return plain if plain.isascii() else _PART.sub(lambda found: f" {_part(found[0])} ", plain)


def english(word: str) -> str:
    """A word in small Latin letters as the English one, if it is one of another language."""
    return _ENGLISH.get(word, word)


def _with_dots(name: str) -> str:
    """A symbol's dots as words: they are a derivative's."""
    apart = unicodedata.normalize("NFD", name)
    return unicodedata.normalize("NFC", _DOTS.sub(lambda found: found[1] + ("_dot" if found[2] == "\u0307" else "_ddot"), apart))


def _bare(letter: str) -> str:
    """A Latin letter without its accent; others as they are (to take a Korean one apart would make another of it)."""
    apart = unicodedata.normalize("NFD", letter)
    return apart[0] if len(apart) > 1 and apart[0].isascii() else letter


def _part(found: str) -> str:
    return next(_PARTS[found[:k]] for k in range(len(found), 0, -1) if found[:k] in _PARTS)
