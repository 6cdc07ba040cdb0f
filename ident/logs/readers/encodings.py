"""The encoding of a text that is not UTF-8: the one in which its names hold words that are known."""

from __future__ import annotations

from ..words import SAID, TIME, words_of

#: What is tried, the likeliest first: of those in which as many words are known, the first counts.
_KNOWN = ("cp1252", "cp1250", "cp1251", "gb18030", "shift_jis", "cp949", "big5")
#: Bytes in which names are looked for.
_FRONT = 8192


def likely_encodings(raw: bytes) -> list[str]:
    """Encodings in which the beginning of a text can be read, the likeliest first: that of Western Europe, and those in which more words
    are known. In all others than the right one, letters beyond ASCII become letters that make no word."""
    front = raw[:_FRONT]
    lines = front.splitlines()
    names = [line for line in (lines[:-1] or lines) if not line.isascii()] or [front]
    found: dict[str, int] = {}
    for encoding in _KNOWN:
        try:
            text = [line.decode(encoding) for line in names]
        except UnicodeDecodeError:
            continue
        found[encoding] = len(frozenset.union(*map(words_of, text)) & (SAID | TIME))
    least = found.get(_KNOWN[0], 0)
    better = [encoding for encoding in found if found[encoding] > least or encoding == _KNOWN[0]]
    return sorted(better, key=lambda encoding: -found[encoding])
