"""Holds environments of Gymnasium or of PettingZoo's parallel interface for the program that started this one, or an agent.

Requests to environments and answers are numbers in shared memory, one block per environment: the kind of request, a seed and the
actions; then how the episode stands, the rewards, the observations, the full state and the metrics. One byte on
standard input says that requests lie there, one byte on standard output that their answers do. Everything else passes
as texts behind such a byte, each with its length before it; so do the numbers of agents. Prints go to standard error.

The files beside this one follow it in one text: `guard.py`, `spaces.py`, `returns.py`, `making.py`, `server.py`,
`actions.py`, `agents.py`, `serving.py`.
"""

import importlib
import importlib.abc
import importlib.util
import json
import linecache
import os
import pickle
import pkgutil
import re
import select
import shutil
import signal
import struct
import sys
import threading
import time
import traceback
import warnings


class Refused(Exception):
    """What cannot be used, at which key of the study, and what to do instead; or what is lacking here."""

    def __init__(self, key, problem, lacks=False):
        super().__init__(problem)
        self.key, self.lacks = key, lacks


class Link:
    """The two ends of the pipes to the program that started this one."""

    def __init__(self):
        self.owner, self.reader, self.writer = os.getpid(), os.dup(0), os.dup(1)
        # Nothing that an environment reads or prints meets what passes here.
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)

    def byte(self):
        return self._read(1)

    def text(self):
        (length,) = struct.unpack("<Q", self._exactly(8))
        return self._exactly(length)

    def _read(self, length):
        self._leave_copies()
        return os.read(self.reader, length)

    def _exactly(self, length):
        pieces, missing = [], length
        while missing:
            piece = self._read(min(missing, 1 << 20))
            if not piece:
                os._exit(0)
            pieces.append(piece)
            missing -= len(piece)
        return b"".join(pieces)

    def say(self, byte, text=None):
        self._leave_copies()
        rest = byte if text is None else byte + struct.pack("<Q", len(text)) + text
        while rest:
            rest = rest[os.write(self.writer, rest) :]

    def _leave_copies(self):
        """A copy of this process that an environment forked has no say here."""
        if os.getpid() != self.owner:
            os._exit(1)


def told(error):
    """What went wrong, and the last lines of where."""
    # Of this file and of the machinery of imports nothing is told.
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    where = [f"{os.path.basename(at.filename)}, line {at.lineno}, in {at.name}: {at.line}" for at in frames[-3:]]
    return "\n".join(["".join(traceback.format_exception_only(type(error), error)).strip(), *reversed(where)])
