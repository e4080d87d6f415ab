"""Holds environments of Gymnasium or of PettingZoo's parallel interface for the program that started this one, or an agent.

Requests to environments and answers are numbers in shared memory, one block per environment: the kind of request, a seed and the
actions; then the state of the episode, the rewards, the observations, the full state and the metrics. One byte on
standard input announces requests, one byte on standard output their answers. Everything else, including the numbers
of agents, passes as texts after such a byte, each preceded by its length. Prints go to standard error.

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
    """A refusal: the problem, the key of the study and the remedy; or a missing part of this machine."""

    def __init__(self, key, problem, lacks=False):
        super().__init__(problem)
        self.key, self.lacks = key, lacks


class Link:
    """The two ends of the pipes to the program that started this one."""

    def __init__(self):
        self.owner, self.reader, self.writer = os.getpid(), os.dup(0), os.dup(1)
        # Input and output of environments must not mix with the messages of the link.
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
        """Ends a copy of this process that an environment forked, so that it cannot use the link."""
        if os.getpid() != self.owner:
            os._exit(1)


def told(error):
    """The error, and the last lines of its traceback."""
    # Lines of this file and of the import system are left out.
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    where = [f"{os.path.basename(at.filename)}, line {at.lineno}, in {at.name}: {at.line}" for at in frames[-3:]]
    return "\n".join(["".join(traceback.format_exception_only(type(error), error)).strip(), *reversed(where)])
