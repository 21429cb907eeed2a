"""The gate of the daemon: who is let in, what is signed, and the secrets that takes."""

from monitor.security.gate import Gate, open_gate
from monitor.security.key import VARIABLE, KeyFileError, find_key, new_key_file, read_key

__all__ = ["VARIABLE", "Gate", "KeyFileError", "find_key", "new_key_file", "open_gate", "read_key"]
