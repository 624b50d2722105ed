"""Addresses of cameras and vehicles as they may be shown, logged, stored and sent: without what opens them.

FFmpeg takes user names, passwords and tokens in any part of an address, cameras invent forms of their own, and people
mistype. So nothing is shown that is not known to be harmless: of the part before an ``@`` nothing, of a query only
names that are listed here, in a path nothing behind the name of a secret, nothing that looks like a token, and no
stream key of RTMP. Any other plain part of a path (``rtsp://host/SECRET``) cannot be told from a stream's name, and is
shown.
"""

from __future__ import annotations

import re
from typing import Final

HIDDEN: Final = "***"
FROM_INPUT: Final = "-"
"""Stands for an address that is read from standard input, where nobody else sees it."""

_COLON: Final = r"(?::|%(?:25)*3[aA])"
_SLASH: Final = r"(?:/|%(?:25)*2[fF])"
_AT: Final = re.compile(r"[@\uff20\ufe6b]|%(?:25)*40")
_SCHEME: Final = re.compile(rf"[A-Za-z][A-Za-z0-9+.\-]*{_COLON}{_SLASH}{{2}}")
_HAS_COLON: Final = re.compile(_COLON)
_END_OF_HOST: Final = re.compile(rf"[?#\\]|{_SLASH}")
_QUERY: Final = re.compile(r"\?|#|%(?:25)*(?:3[fF]|23)")
_SECRET_NAME: Final = re.compile(
    r"(?i)((?:us(?:e?r|rname)|log[io]n|acc(?:ou)?nt|pass|pwd|psw|pw|token|auth|key|secret|sess|sig|cred)"
    r"[A-Za-z0-9_.\-]*?(?:=|%(?:25)*3D))[^/?#\s]+"
)
_AFTER_SLASH: Final = r"(?:(?<=/)|(?<=%2[fF]))"
_SECRET_FOLDER: Final = re.compile(
    rf"(?i){_AFTER_SLASH}(pass(?:word|wd|phrase)?|pwd|psw|(?:access_?)?token|auth|(?:stream_?|api_?)?key|secret|session)"
    rf"({_SLASH})[^/?#%\s]+"
)
_TOKEN: Final = re.compile(
    rf"{_AFTER_SLASH}(?=[A-Za-z]*[0-9])(?=[0-9a-z]*[A-Z])(?=[0-9A-Z]*[a-z])[A-Za-z0-9]{{16,}}(?=$|[/?#%'\"\s])"
)
"""Part of a path with digits, capital and small letters, as cameras and recorders draw them by lot."""
_STREAM_KEY: Final = re.compile(rf"(?i)^(rtmp[a-z]*{_COLON}{_SLASH}{{2}}[^/]+/.*/)[^/]+$")
_HARMLESS: Final = frozenset(
    {
        # mission.vehicle.ardrone.url
        *("at", "navdata", "video", "declination", "scale", "codec", "size"),
        # FFmpeg's udp, rtp, rtsp, tcp, srt
        *(
            "localaddr",
            "localport",
            "localrtpport",
            "localrtcpport",
            "rtcpport",
            "pkt_size",
            "fifo_size",
            "buffer_size",
        ),
        *("overrun_nonfatal", "reuse", "ttl", "timeout", "listen", "mode", "latency", "connect", "sources", "block"),
        # cameras
        *("channel", "subtype", "stream", "profile", "resolution", "fps", "framerate", "width", "height", "unicast"),
    }
)
"""Names in a query whose values are shown."""
_HARMLESS_PAIR: Final = re.compile(r"([A-Za-z_]+)=[A-Za-z0-9_.,:\[\]\-]*")
_SPACED_LOGIN: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.\-]*://)[^/@\s:]*:[^/@\n]*? [^/@\n]*@(?=[\w\[])")
"""In a sentence: user and a password with blanks in it."""
_TRAILING: Final = re.compile(r"[)\]>'\"`.,;:!]*$")


def shown_address(address: str) -> str:
    """A whole address without user, password and token; other text comes back as it is.

    >>> shown_address("rtsp://pilot:secret@camera/live?channel=1&token=4711")
    'rtsp://***@camera/live?channel=1&***'
    """
    scheme = _SCHEME.match(address)
    start = 0 if scheme is None else scheme.end()
    head, rest = address[:start], _without_user(address[start:], after_scheme=scheme is not None)
    query = _QUERY.search(rest)
    if query is None:
        return _shown_path(head + rest)
    path, mark, pairs = rest[: query.start()], query[0], rest[query.end() :]
    return _shown_path(head + path) + mark + _shown_query(pairs)


def has_secret(address: str) -> bool:
    """Whether an address holds anything that is not shown."""
    return shown_address(address) != address


def without_secrets(text: str) -> str:
    """A message with each of its words that is an address as `shown_address` shows it: the second net."""
    return re.sub(r"\S+", lambda word: _shown_word(word[0]), _SPACED_LOGIN.sub(rf"\1{HIDDEN}@", text))


def _shown_word(word: str) -> str:
    at = _AT.search(word)
    logs_in = at is not None and _HAS_COLON.search(word, 0, at.start()) is not None
    scheme = _SCHEME.search(word)
    if scheme is None and not logs_in and _SECRET_NAME.search(word) is None:
        return word
    end = _TRAILING.search(word)
    stop = len(word) if end is None else end.start()
    start = 0 if scheme is None or _HAS_COLON.search(word, 0, scheme.start()) else scheme.start()  # a quotation mark
    return word[:start] + shown_address(word[start:stop]) + word[stop:]


def _without_user(rest: str, *, after_scheme: bool) -> str:
    """What follows the scheme, without all that stands before the last ``@``, unless that is certainly no login."""
    ats = list(_AT.finditer(rest))
    if not ats or ats[-1].start() == 0:
        return rest
    host_end = _END_OF_HOST.search(rest)
    in_host = after_scheme and ats[0].start() < (len(rest) if host_end is None else host_end.start())
    # A slash in a password ends the host early, and leaves a colon before the "@".
    if in_host or _HAS_COLON.search(rest, 0, ats[-1].start()) is not None:
        return f"{HIDDEN}@{rest[ats[-1].end() :]}"
    return rest


def _shown_path(address: str) -> str:
    shown = _SECRET_NAME.sub(rf"\1{HIDDEN}", address)
    if _SCHEME.match(address) is None:
        return shown  # a file's name is no token
    shown = _SECRET_FOLDER.sub(rf"\1\2{HIDDEN}", shown)
    return _STREAM_KEY.sub(rf"\1{HIDDEN}", _TOKEN.sub(HIDDEN, shown))


def _shown_query(pairs: str) -> str:
    shown: list[str] = []
    for pair in re.split(r"[&;]", pairs):
        known = _HARMLESS_PAIR.fullmatch(pair)
        each = pair if not pair or (known is not None and known[1].lower() in _HARMLESS) else HIDDEN
        if each != HIDDEN or HIDDEN not in shown:
            shown.append(each)
    return "&".join(shown)
