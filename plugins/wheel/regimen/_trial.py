"""The calls by which a program is a trial of regimen.

    trial = regimen.trial()
    env = trial.environment()                            # what the trial learns in
    trial.log(step=1000, ret=12.5)                       # a metric that the program says
    trial.measure(lambda observations: ..., step=1000)   # the engine measures where a measurement is due
    trial.measure(lambda observations: ...)              # the last measurement, which tables show

In a trial, a program whose environment lacks the package finds this file as the module `regimen_trial`. It needs the
standard library alone, but for `environment`:

    import regimen_trial as regimen
"""

from __future__ import annotations

import importlib
import json
import math
import os
import socket
import struct
from array import array

# In front of numbers, and of the end: how many rows and columns follow, or 0 and how many bytes of JSON.
_HEAD = struct.Struct("<II")


def trial():
    """The trial that this program is. Started by hand it is none: what it logs is printed then."""
    return Trial()


class Trial:
    """A trial, from within its program."""

    def __init__(self):
        self._log = os.environ.get("REGIMEN_LOG")
        told = os.environ.get("REGIMEN_TRIAL")
        self._told = None
        if told is not None:
            with open(told, encoding="utf-8") as file:
                self._told = json.load(file)

    def log(self, *, step, **values):
        """Says values of metrics at a step. A study reads them with `from: log`, each by its name here.

        Every call writes one line at once, so that threads, forks and a sudden end cost no line of others.
        """
        said = {"step": int(step)}
        for name, value in values.items():
            said[name] = _number(name, value)
        line = json.dumps(said)
        if self._log is None:
            print(line, flush=True)
            return
        file = os.open(self._log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            os.write(file, f"{line}\n".encode())
        finally:
            os.close(file)

    def environment(self, num_envs=None):
        """The simulator of the trial: an environment of Gymnasium, or with `num_envs` a vector of them.

        The first `reset` without a seed begins what the environments of built-in agents begin with this seed. A seed
        that is given opens a stream of its own.
        """
        simulator = self._of_trial("environment")["simulator"]
        regimen = importlib.import_module("regimen")
        made = (
            regimen.make(simulator["plugin"], simulator["config"])
            if num_envs is None
            else regimen.make_vec(simulator["plugin"], simulator["config"], num_envs=num_envs)
        )
        if made._simulation.native.stream_id() != simulator["stream_id"]:
            raise RuntimeError(
                f"the package `regimen` of this Python has another `{simulator['plugin']}` than the program that runs "
                "the trial: install the package of the same version"
            )
        made._learns = self._told["seed"]
        return made

    def measure(self, act, *, step=None):
        """Lets the engine measure `act` on its own episodes, which are those of the built-in agents of the study.

        `act` is called with a row of numbers for each episode under way, as an array of NumPy where that is there and
        as a list of lists elsewhere, and gives back an action for each. With a step it is measured where a measurement
        is due: once for each multiple of the protocol's `evaluate_every`. Without one it is the last measurement, which
        is made once. Gives back the mean of each metric, or `None` where nothing was due.
        """
        path = self._of_trial("measure")["measured_at"]
        if path is None:
            raise RuntimeError("this trial measures no calls: write `measured: calls` into the study")
        with socket.socket(socket.AF_UNIX) as link:
            link.connect(path)
            link.sendall(f"{json.dumps({'step': None if step is None else int(step)})}\n".encode())
            with link.makefile("rb") as told:
                while True:
                    rows, columns = _HEAD.unpack(_exactly(told, _HEAD.size))
                    if rows == 0:
                        return json.loads(_exactly(told, columns))
                    link.sendall(_answer(act, _exactly(told, 8 * rows * columns), rows, columns))

    def _of_trial(self, what):
        if self._told is None:
            raise RuntimeError(f"`{what}` is of a trial: start this program by a study, with `regimen run`")
        return self._told


def _answer(act, observed, rows, columns):
    """The actions for observations, both as bytes."""
    numbers = array("d", observed)
    numpy = _numpy()
    if numpy is None:
        observations = [list(numbers[row * columns : (row + 1) * columns]) for row in range(rows)]
        actions = [list(it) if hasattr(it, "__iter__") else [it] for it in act(observations)]
        actions = array("d", _flat(actions, rows))
    else:
        observations = numpy.array(numbers).reshape(rows, columns)
        actions = numpy.asarray(act(observations), numpy.float64)
        if actions.ndim == 0 or len(actions) != rows:
            raise ValueError(f"`act` was given {rows} rows and gave back an array of shape {actions.shape}")
        actions = actions.reshape(-1)
    return _HEAD.pack(rows, len(actions) // rows) + actions.tobytes()


def _numpy():
    """The module `numpy`, or `None` where there is none."""
    try:
        return importlib.import_module("numpy")
    except ImportError:
        return None


def _flat(actions, rows):
    """The entries of actions, which are equally long."""
    if len(actions) != rows or len({len(action) for action in actions}) != 1:
        raise ValueError(f"`act` was given {rows} rows, and gave back {len(actions)} or of different lengths")
    return [float(entry) for action in actions for entry in action]


def _exactly(told, length):
    """As many bytes of what the engine tells."""
    read = told.read(length)
    if len(read) < length:
        raise RuntimeError("the engine ended the measurement")
    return read


def _number(name, value):
    """A number as JSON has it; one that is not finite, which ends the trial as `nan`, as a word."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        said = repr(value)
        said = said if len(said) <= 60 else f"{said[:59]}…"
        problem = f"`{name}` is {said}, and a value of a metric is one number"
        raise TypeError(problem) from None
    return number if math.isfinite(number) else str(number)
