"""Who may speak to the console: sessions in signed cookies, and the hosts and origins that are answered at all.

A page of another site may make the operator's browser send requests here; its Origin gives it away, and the cookie is
not sent along (SameSite=Strict). A name that somebody's own DNS server
points at this machine is no host that we answer to.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from gcs_plugin.authority.rate import TokenBucket
from gcs_plugin.console.passwords import Passwords, Role

COOKIE: Final = "sidestep"
SESSION_S: Final = 12 * 3600.0
_MOST_SESSIONS: Final = 1000
_MOST_CALLERS: Final = 1000
_LOGINS_PER_S: Final = 0.2
_LOGIN_BURST: Final = 5.0


@dataclass(frozen=True, slots=True)
class Session:
    """One browser that has been let in."""

    id: str
    role: Role
    name: str
    caller: str
    """Address and browser; a cookie that comes from another one is a stolen one."""
    started_s: float


class Access:
    """Sessions and their cookies.

    Args:
        passwords: who is let in as what.
        clock: monotonic seconds.
    """

    def __init__(self, passwords: Passwords, clock: Callable[[], float]) -> None:
        self._passwords = passwords
        self._clock = clock
        self._key = secrets.token_bytes(32)
        self._sessions: dict[str, Session] = {}
        self._callers: dict[str, TokenBucket] = {}
        self._count = 0

    @property
    def password_needed(self) -> bool:
        """Whether a session begins with a password."""
        return self._passwords.needed

    def may_try(self, address: str) -> bool:
        """Whether this address may try a password now; if so it is counted."""
        bucket = self._callers.setdefault(address, TokenBucket(_LOGINS_PER_S, _LOGIN_BURST))
        while len(self._callers) > _MOST_CALLERS:
            del self._callers[next(iter(self._callers))]
        return bucket.take(self._clock())

    def role(self, password: str) -> Role | None:
        """What a password gives; slow on purpose."""
        return self._passwords.role(password)

    def begin(self, role: Role, caller: str) -> str:
        """A new session. Returns its cookie's value."""
        self._count += 1
        name = f"{'Operator' if role == 'commander' else 'Viewer'} {self._count}"
        session = Session(secrets.token_urlsafe(18), role, name, caller, self._clock())
        self._sessions[session.id] = session
        while len(self._sessions) > _MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        return f"{session.id}.{self._signature(session.id)}"

    def session(self, cookie: str, caller: str) -> Session | None:
        """The session of a cookie; None where it is forged, stolen or over."""
        name, _, signature = cookie.partition(".")
        if not hmac.compare_digest(signature.encode("utf-8", "replace"), self._signature(name).encode("ascii")):
            return None
        session = self._sessions.get(name)
        if session is None or session.caller != caller or self._clock() - session.started_s > SESSION_S:
            return None
        return session

    def end(self, session: Session) -> None:
        """The session is over, whoever still has its cookie."""
        self._sessions.pop(session.id, None)

    def _signature(self, name: str) -> str:
        return hmac.new(self._key, name.encode("utf-8", "replace"), hashlib.sha256).hexdigest()


def host_allowed(host: str, allowed: Collection[str]) -> bool:
    """Whether a Host header names this server.

    Args:
        host: the header, with or without a port.
        allowed: names and addresses.
    """
    try:
        name = urlsplit(f"//{host}").hostname
    except ValueError:
        return False
    return name is not None and name in allowed


def origin_allowed(origin: str | None, scheme: str, host: str) -> bool:
    """Whether a request comes from our own page: its Origin is the address that it asks for."""
    return origin is not None and origin.lower() == f"{scheme}://{host}".lower()
