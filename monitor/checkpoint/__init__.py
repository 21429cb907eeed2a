"""What the monitor has learnt, kept so that a restart in flight comes back with it.

==============  =================================================================================
``graph``       objects to data and back; no code comes out of a file
``file``        the file: atomic, of its owner alone, checked
``identity``    which code, which settings, when
``snapshot``    what is kept, and what must be true of who takes it up
``keeper``      :class:`Checkpointer`: every few seconds and at the end, written by a thread
==============  =================================================================================

A snapshot taken between two turns and taken up by a fresh process equals never having stopped: the
restart is a gap in the input, no more.
"""

from monitor.checkpoint.file import Unusable
from monitor.checkpoint.keeper import Checkpointer
from monitor.checkpoint.snapshot import Resumable, Snapshot, load, take

__all__ = ["Checkpointer", "Resumable", "Snapshot", "Unusable", "load", "take"]
