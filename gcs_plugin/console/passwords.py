"""The console's password file: a line for each role (``viewer:``, ``commander:``), hashed with scrypt (RFC 7914)."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
from pathlib import Path
from typing import Final, Literal, get_args

from gcs_plugin.durable import write_whole
from mission.errors import SettingsError

Role = Literal["viewer", "commander"]
_N, _R, _P = 2**14, 8, 1
_LEAST_LETTERS: Final = 8


class Passwords:
    """Who a password lets in.

    Args:
        hashes: salt and hash by role; none let everybody in as commander.
    """

    def __init__(self, hashes: dict[Role, tuple[bytes, bytes]]) -> None:
        self._hashes = hashes

    @property
    def needed(self) -> bool:
        """Whether a password is asked for."""
        return bool(self._hashes)

    def role(self, password: str) -> Role | None:
        """The role that a password gives; None for a wrong one. Takes some 50 ms for each role."""
        if not self._hashes:
            return "commander"
        fitting = [
            role for role, (salt, known) in self._hashes.items() if hmac.compare_digest(_hash(password, salt), known)
        ]
        return "commander" if "commander" in fitting else (fitting[0] if fitting else None)


def read_passwords(path: Path | None) -> Passwords:
    """The file's passwords.

    Raises:
        SettingsError: it cannot be read, is no such file, or others may read it.
    """
    if path is None:
        return Passwords({})
    remedy = "Make it with `sidestep console --set-password commander`."
    try:
        if path.stat().st_mode & 0o077:
            raise SettingsError(f"others may read {path}", f"chmod 600 {path}")
        lines = path.read_text(encoding="ascii").split()
    except OSError as error:
        raise SettingsError(f"cannot read {path}: {error.strerror}", remedy) from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} is no password file", remedy) from error
    found: dict[Role, tuple[bytes, bytes]] = {}
    for line in lines:
        name, _, rest = line.partition(":")
        salt, _, known = rest.partition("$")
        try:
            role = next(role for role in get_args(Role) if role == name)
            found[role] = base64.b64decode(salt, validate=True), base64.b64decode(known, validate=True)
        except (StopIteration, binascii.Error) as error:
            raise SettingsError(f"{path} is no password file", remedy) from error
    if not found:
        raise SettingsError(f"{path} holds no password", remedy)
    return Passwords(found)


def set_password(path: Path, role: Role, password: str) -> None:
    """Write a role's password into the file, beside the others'.

    Raises:
        SettingsError: it is too short, or the file is no password file.
        AnswerError: it cannot be written.
    """
    if len(password) < _LEAST_LETTERS:
        raise SettingsError("the password is too short", f"Use {_LEAST_LETTERS} letters or more.")
    others = []
    if path.exists():
        read_passwords(path)
        others = [line for line in path.read_text(encoding="ascii").split() if not line.startswith(f"{role}:")]
    salt = secrets.token_bytes(16)
    coded = (base64.b64encode(part).decode("ascii") for part in (salt, _hash(password, salt)))
    path.touch(mode=0o600)
    write_whole(path, "".join(f"{line}\n" for line in [*others, f"{role}:{'$'.join(coded)}"]).encode("ascii"))
    path.chmod(0o600)


def _hash(password: str, salt: bytes) -> bytes:
    return hashlib.scrypt(password.encode("utf-8"), salt=salt, n=_N, r=_R, p=_P)
