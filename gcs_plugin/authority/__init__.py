"""Who may give orders over the link: allowed senders, signed frames, limited rates."""

from gcs_plugin.authority.authority import Authority, Refusal
from gcs_plugin.authority.signature_memory import SignatureMemory
from gcs_plugin.authority.signing import read_key

__all__ = ["Authority", "Refusal", "SignatureMemory", "read_key"]
