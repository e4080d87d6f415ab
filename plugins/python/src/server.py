"""Holds environments of Gymnasium or of PettingZoo's parallel interface for the program that started this one.

Requests and answers are numbers in shared memory, one block per environment: the kind of request, a seed and the
actions; then how the episode stands, the rewards and the observations. One byte on standard input says that requests
lie there, one byte on standard output that their answers do. What is no number passes as texts behind such a byte,
each with its length before it. What environments print goes to standard error.
"""

import importlib
import importlib.abc
import importlib.util
import json
import linecache
import os
import pickle
import re
import select
import signal
import struct
import sys
import threading
import time
import traceback
import warnings

# Blocks in the shared memory; their list of requests stands before them.
MOST_ENVIRONMENTS = 8192
# Kinds of request.
STEP, RESET, RENEW = 1, 2, 3
# How an episode stands.
GOING_ON, TERMINATED, TRUNCATED = 0, 1, 2
# Steps of a rehearsal, and how long one may take, as may the start: a hang must not last.
REHEARSED_STEPS = 10
PATIENCE_S = 300


class Refused(Exception):
    """What cannot be used, at which key of the study, and what to do instead; or what is lacking here."""

    def __init__(self, key, problem, lacks=False):
        super().__init__(problem)
        self.key, self.lacks = key, lacks


class Link:
    """The two ends of the pipes to the program that started this one."""

    def __init__(self):
        self.reader, self.writer = os.dup(0), os.dup(1)
        # Nothing that an environment reads or prints meets what passes here.
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)

    def byte(self):
        return os.read(self.reader, 1)

    def text(self):
        (length,) = struct.unpack("<Q", self._exactly(8))
        return self._exactly(length)

    def _exactly(self, length):
        pieces, missing = [], length
        while missing:
            piece = os.read(self.reader, min(missing, 1 << 20))
            if not piece:
                os._exit(0)
            pieces.append(piece)
            missing -= len(piece)
        return b"".join(pieces)

    def say(self, byte, text=None):
        rest = byte if text is None else byte + struct.pack("<Q", len(text)) + text
        while rest:
            rest = rest[os.write(self.writer, rest) :]


def end_with_parent(reader):
    """Ends this process with the one that started it, be it in the middle of a step."""
    die_with_parent()

    def watch():
        hung_up = select.poll()
        hung_up.register(reader, 0)
        hung_up.poll()
        # Time for environments to close; a step that does not end gets no more.
        time.sleep(5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def die_with_parent():
    if sys.platform == "linux":
        import ctypes

        set_parent_death_signal = 1
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL, 0, 0, 0)


def told(error):
    """What went wrong, and the last lines of where."""
    # Of this file and of the machinery of imports nothing is told.
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    where = [f"{os.path.basename(at.filename)}, line {at.lineno}, in {at.name}: {at.line}" for at in frames[-3:]]
    return "\n".join(["".join(traceback.format_exception_only(type(error), error)).strip(), *reversed(where)])


# --- What makes environments ---------------------------------------------------------------------------------


class Sources(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Modules from texts that were handed over: a trial runs what its id names, whatever becomes of the files."""

    def __init__(self, files):
        self.files = {os.path.splitext(os.path.basename(file["path"]))[0]: file for file in files}

    def find_spec(self, name, path=None, target=None):
        file = self.files.get(name)
        return file and importlib.util.spec_from_loader(name, self, origin=file["path"])

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        file = self.files[module.__name__]
        path, text = file["path"], file["text"]
        module.__file__ = path
        linecache.cache[path] = (len(text), None, text.splitlines(True), path)
        exec(compile(text, path, "exec"), module.__dict__)


def function_of(make, sources):
    """What is called to make an environment."""
    if "file" in make:
        sys.meta_path.insert(0, Sources([make["file"], *sources]))
        module = importlib.import_module(os.path.splitext(os.path.basename(make["file"]["path"]))[0])
        if not callable(getattr(module, make["call"], None)):
            raise Refused("make", f"`{make['file']['path']}` has no function `{make['call']}`")
        return getattr(module, make["call"])
    sys.meta_path.insert(0, Sources(sources))
    package, name = make["package"], make["name"]
    if package == "gymnasium":
        import gymnasium

        return lambda **arguments: gymnasium.make(name, **{"disable_env_checker": True, **arguments})
    return parallel_function(name)


def parallel_function(name):
    """`parallel_env` of `pettingzoo.NAME`, or of `NAME` where there is no such module."""
    try:
        module = importlib.import_module(f"pettingzoo.{name}")
    except ModuleNotFoundError as error:
        if not f"pettingzoo.{name}".startswith(error.name or " "):
            raise
        module = importlib.import_module(name)
    if not hasattr(module, "parallel_env"):
        raise Refused("make", f"`{module.__name__}` has no parallel interface: it has no function `parallel_env`")
    return module.parallel_env


def found_module(make, sources, interpreter):
    try:
        import gymnasium  # noqa: F401
        import numpy  # noqa: F401

        return function_of(make, sources)
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        own = ", and a file of your own is named under `sources`, as in `sources: [{ file: model.py }]`"
        raise Refused(
            "make",
            f"{told(error)}\n`{interpreter} -m pip install {missing}` installs a package for this Python; another Python "
            f"is named under `interpreter`{own if 'file' in make else ''}",
        ) from error


# --- The lock file -------------------------------------------------------------------------------------------


def versions_in(path, text):
    """Names and versions of packages, of `name==version` lines or of a lock file in TOML."""
    if path.endswith((".toml", ".lock")):
        import tomllib

        document = tomllib.loads(text)
        packages = document.get("package", []) + document.get("packages", [])
        return [(plain(package["name"]), package["version"]) for package in packages if "version" in package]
    pinned = re.findall(r"^\s*(?:- )?([A-Za-z0-9][\w.-]*)(?:\[[^\]]*\])?\s*==\s*([^\s;\\#]+)", text, re.MULTILINE)
    return [(plain(name), version) for name, version in pinned]


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def found_beside_wanted(lock):
    """By package of a lock file: the version that is installed, or `None`, and those that are wanted."""
    from importlib.metadata import PackageNotFoundError, version

    # A lock file for several platforms may name several versions of one package.
    wanted = {}
    for name, expected in versions_in(lock["path"], lock["text"]):
        wanted.setdefault(name, []).append(expected)
    found = {}
    for name, expected in wanted.items():
        try:
            found[name] = (version(name), expected)
        except PackageNotFoundError:
            found[name] = (None, expected)
    return found


def how_to_install(lock, interpreter):
    if lock["path"].endswith((".toml", ".lock")):
        return f"install what `{lock['path']}` says"
    return f"`{interpreter} -m pip install -r {lock['path']}` installs what it says"


def hold_against_lock(lock, interpreter):
    """The id of a trial names the lock file, so what is installed must be what it says."""
    packages = found_beside_wanted(lock)
    if "gymnasium" not in packages:
        raise Refused(
            "lock", f"`{lock['path']}` pins no version of gymnasium: write it by `{interpreter} -m pip freeze`"
        )
    different = [
        f"{name} {found} in place of {' or '.join(expected)}"
        for name, (found, expected) in packages.items()
        # A lock file may hold packages of other platforms.
        if found and found.split("+")[0] not in [version.split("+")[0] for version in expected]
    ]
    if different:
        raise Refused(
            "lock",
            f"installed is not what `{lock['path']}` says: {', '.join(different)}; {how_to_install(lock, interpreter)}, and "
            f"`{interpreter} -m pip freeze` writes it anew, which makes new trials",
            lacks=True,
        )


def is_of_an_import(error):
    # Gymnasium has an error of its own for packages that single environments need.
    return isinstance(error, ImportError) or type(error).__name__ == "DependencyNotInstalled"


def refusal(error, lock, interpreter):
    """What cannot be used, for the program that asked. Where a module cannot be imported, and a package of the lock
    file is not there, it is this machine that lacks something, and neither the study nor its code is wrong."""
    key, lacks = getattr(error, "key", "make"), getattr(error, "lacks", False)
    problem = str(error) if isinstance(error, Refused) else told(error)
    cause = error.__cause__ if isinstance(error, Refused) else error
    if is_of_an_import(cause):
        missing = [f"{name} {' or '.join(wanted)}" for name, (found, wanted) in found_beside_wanted(lock).items() if not found]
        if missing:
            lacks, install = True, how_to_install(lock, interpreter)
            problem = f"needs {', '.join(missing)}, which this Python lacks; {install}\n{problem}"
    return json.dumps({"key": key, "problem": problem, "lacks": lacks}).encode()


# --- Spaces as numbers ---------------------------------------------------------------------------------------


def refuse_space(space, place, instead):
    raise Refused("make", f"{place} is a space of kind {type(space).__name__}, which is not supported: {instead}")


class BoxNumbers:
    """A box entry by entry; an action has its entries within -1 and 1."""

    def __init__(self, space, name, place, is_action):
        import numpy

        self.size, self.shape, self.dtype = int(numpy.prod(space.shape)), space.shape, space.dtype
        self.place = place
        low, high = (numpy.asarray(limit, dtype=float).reshape(-1) for limit in (space.low, space.high))
        names = [name] if self.size == 1 else [f"{name}_{index}" for index in range(self.size)]
        limits = zip(names, low.tolist(), high.tolist())
        self.channels = [{"name": it, "low": finite(least), "high": finite(most)} for it, least, most in limits]
        if is_action:
            self._scale(low, high, place)

    def _scale(self, low, high, place):
        import numpy

        if not numpy.issubdtype(self.dtype, numpy.floating):
            raise Refused(
                "make",
                f"{place} is a box of whole numbers ({self.dtype}), which is not supported: declare it `Discrete`, "
                "or take float numbers and round them in `step`",
            )
        if any(channel["low"] is None or channel["high"] is None for channel in self.channels):
            raise Refused(
                "make",
                f"{place} is a box without limits, which is not supported: agents act between a lowest and a "
                "highest value. Give it limits, as gymnasium.wrappers.RescaleAction does",
            )
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        # Rounding is monotone, so that only limits which are not met exactly can be passed.
        exact = (self.middle + self.half == high).all() and (self.middle - self.half == low).all()
        self.limits = None if exact else (low, high)

    def write(self, value, row):
        import numpy

        value = numpy.asarray(value)
        if value.size != self.size:
            raise ValueError(f"{self.place} has {value.size} entries in place of {self.size}")
        row[:] = value.reshape(-1)

    def read(self, row):
        value = self.middle + row * self.half
        if self.limits is not None:
            value = value.clip(*self.limits)
        return value.reshape(self.shape).astype(self.dtype)

    def draw(self, random):
        return random.uniform(-1.0, 1.0, self.size)


class DiscreteNumbers:
    """A choice: the index of an action, one number per option of an observation, 1 for the one that holds."""

    def __init__(self, space, name, is_action):
        self.options, self.start = int(space.n), int(space.start)
        names = [str(self.start + index) for index in range(self.options)]
        self.choice = {"name": name, "options": names}
        self.channels = [{"name": f"{name}_{it}", "low": 0.0, "high": 1.0} for it in names]
        self.size = 1 if is_action else self.options

    def write(self, value, row):
        row[:] = 0.0
        index = int(value) - self.start
        if not 0 <= index < self.options:
            raise ValueError(f"{value} is none of the {self.options} options of a discrete space")
        row[index] = 1.0

    def read(self, row):
        return int(row[0]) + self.start

    def draw(self, random):
        return [float(random.integers(self.options))]


class DictNumbers:
    """The entries of a dictionary one after the other."""

    def __init__(self, parts):
        self.parts, self.channels, self.size = [], [], 0
        for key, part in parts:
            self.parts.append((key, part, slice(self.size, self.size + part.size)))
            self.channels += part.channels
            self.size += part.size

    def write(self, value, row):
        for key, part, at in self.parts:
            part.write(value[key], row[at])

    def read(self, row):
        return {key: part.read(row[at]) for key, part, at in self.parts}

    def draw(self, random):
        return [number for _, part, _ in self.parts for number in part.draw(random)]


def numbers_of(space, place, is_action, name=None):
    from gymnasium import spaces

    word = "action" if is_action else "observation"
    if isinstance(space, spaces.Box):
        return BoxNumbers(space, name or word, place, is_action)
    if isinstance(space, spaces.Discrete) and not (is_action and name):
        return DiscreteNumbers(space, name or word, is_action)
    if isinstance(space, spaces.Dict):
        below = [(key, f"{name}_{key}" if name else str(key)) for key in space.spaces]
        parts = [(key, numbers_of(space[key], f"{place}[{key!r}]", is_action, it)) for key, it in below]
        return with_names_of_their_own(DictNumbers(parts), place)
    instead = "a box (with limits), a dictionary of boxes or one discrete choice is wanted, for example by "
    instead += "gymnasium.wrappers." + ("TransformAction" if is_action else "FlattenObservation")
    refuse_space(space, place, instead)


def with_names_of_their_own(numbers, place):
    names = [channel["name"] for channel in numbers.channels]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise Refused("make", f"{place} has two entries called {', '.join(twice)}: rename a key of the dictionary")
    return numbers


def finite(limit):
    """A limit, `None` where there is none; the largest numbers of single precision stand for none too."""
    return limit if abs(limit) < 1e30 else None


def form(numbers):
    if isinstance(numbers, DiscreteNumbers) and numbers.size == 1:
        return {"choice": numbers.choice}
    return {"box": numbers.channels}


# --- Environments --------------------------------------------------------------------------------------------


class Single:
    """How an environment of Gymnasium is started and stepped."""

    def __init__(self, environment):
        self.observation = numbers_of(environment.observation_space, "the observation", False)
        self.action = numbers_of(environment.action_space, "the action", True)
        self.asked, self.answered = self.action.size, 2 + self.observation.size

    def seats(self):
        return [{"name": "", "observation": form(self.observation), "action": form(self.action)}]

    def reset(self, environment, seed, row):
        self.observation.write(environment.reset(seed=seed)[0], row[2:])
        row[0], row[1] = GOING_ON, 0.0

    def step(self, environment, asked, row):
        stepped = environment.step(self.action.read(asked))
        if len(stepped) != 5:
            raise ValueError(
                f"step returned {len(stepped)} values in place of observation, reward, terminated, truncated, info"
            )
        observation, row[1], terminated, truncated, _ = stepped
        self.observation.write(observation, row[2:])
        row[0] = TERMINATED if terminated else TRUNCATED if truncated else GOING_ON

    def draw(self, random):
        return self.action.draw(random)


class Parallel:
    """How an environment of PettingZoo's parallel interface is started and stepped: a seat for each agent."""

    def __init__(self, environment):
        self.agents = list(environment.possible_agents)
        of = "the {} of agent {!r}"
        self.observations = [
            numbers_of(environment.observation_space(agent), of.format("observation", agent), False)
            for agent in self.agents
        ]
        self.actions = [
            numbers_of(environment.action_space(agent), of.format("action", agent), True) for agent in self.agents
        ]
        self.asked = sum(action.size for action in self.actions)
        self.first = 1 + len(self.agents)
        self.answered = self.first + sum(observation.size for observation in self.observations)

    def seats(self):
        each = zip(self.agents, self.observations, self.actions)
        return [{"name": str(it), "observation": form(seen), "action": form(done)} for it, seen, done in each]

    def reset(self, environment, seed, row):
        observations = environment.reset(seed=seed)[0]
        self._all_are_there(environment, "after reset")
        row[: self.first] = 0.0
        self._write(observations, row)

    def step(self, environment, asked, row):
        actions, at = {}, 0
        for agent, action in zip(self.agents, self.actions):
            actions[agent] = action.read(asked[at : at + action.size])
            at += action.size
        observations, rewards, terminations, truncations, _ = environment.step(actions)
        row[0] = self._standing(environment, terminations, truncations)
        row[1 : self.first] = [rewards[agent] for agent in self.agents]
        self._write(observations, row)

    def _standing(self, environment, terminations, truncations):
        left = [bool(terminations[agent] or truncations[agent]) for agent in self.agents]
        if not any(left):
            self._all_are_there(environment, "while nobody has ended")
            return GOING_ON
        if not all(left):
            gone = [agent for agent, ended in zip(self.agents, left) if ended]
            raise ValueError(
                f"{', '.join(map(str, gone))} left before the others, which is not supported: let agents stay to "
                "the end with observations of zeros, as black_death_v3 of SuperSuit does"
            )
        return TERMINATED if all(terminations[agent] for agent in self.agents) else TRUNCATED

    def _all_are_there(self, environment, when):
        missing = [agent for agent in self.agents if agent not in environment.agents]
        if missing:
            raise ValueError(
                f"{', '.join(map(str, missing))} of the possible agents is missing {when}, which is not supported"
            )

    def _write(self, observations, row):
        at = self.first
        for agent, observation in zip(self.agents, self.observations):
            observation.write(observations[agent], row[at : at + observation.size])
            at += observation.size

    def draw(self, random):
        return [number for action in self.actions for number in action.draw(random)]


def kind_of(environment):
    import gymnasium

    if isinstance(environment, gymnasium.Env):
        return Single(environment)
    if all(hasattr(environment, name) for name in ("possible_agents", "action_space", "reset", "step")):
        if hasattr(environment, "agent_iter"):
            raise Refused(
                "make",
                "agents take turns in this environment (AEC): make it by its `parallel_env`, or convert it by "
                "pettingzoo.utils.aec_to_parallel",
            )
        return Parallel(environment)
    raise Refused(
        "make",
        f"what it makes is of type {type(environment).__name__}, which is neither a gymnasium.Env nor an environment of "
        "PettingZoo's parallel interface",
    )


class Server:
    """The environments of one trial."""

    def __init__(self, link, asked):
        interpreter = asked["interpreter"]
        hold_against_lock(asked["lock"], interpreter)
        call = found_module(asked["make"], asked["sources"], interpreter)
        import mmap

        import numpy

        self.lock, self.interpreter = asked["lock"], interpreter
        self.link, self.make = link, lambda: call(**asked["arguments"])
        first = self.make()
        self.kind = kind_of(first)
        self.environments, self.ended, self.first_is_new = {0: first}, set(), True
        length = 2 + self.kind.asked + self.kind.answered
        size = 8 * (1 + MOST_ENVIRONMENTS + MOST_ENVIRONMENTS * length)
        handle, self.path, self.remove = shared_memory(size)
        self.memory = mmap.mmap(handle, size)
        self.requests = numpy.ndarray(1 + MOST_ENVIRONMENTS, "<i8", self.memory)
        blocks = (MOST_ENVIRONMENTS, length)
        self.blocks = numpy.ndarray(blocks, "<f8", self.memory, self.requests.nbytes)

    def face(self):
        return {"memory": self.path, "remove": self.remove, "seats": self.kind.seats()}

    def answer_requests(self):
        """Does what lies in shared memory, for all environments that wait."""
        kind, first_answer = self.kind, 2 + self.kind.asked
        for slot in self.requests[1 : 1 + self.requests[0]].tolist():
            block = self.blocks[slot]
            what, row = block[0], block[first_answer:]
            if what == STEP:
                kind.step(self.environments[slot], block[2:first_answer], row)
                if row[0] != GOING_ON:
                    self.ended.add(slot)
            else:
                if what == RENEW:
                    self.renew(slot)
                self.ended.discard(slot)
                kind.reset(self.environments[slot], int(block[1]), row)

    def renew(self, slot):
        """An environment as it was made: what another one went through does not reach it."""
        if self.first_is_new and slot == 0:
            # It was made to be looked at.
            self.first_is_new = False
            return
        self.close(slot)
        self.environments[slot] = self.make()

    def close(self, slot):
        if slot in self.environments:
            self.environments.pop(slot).close()

    def rehearse(self, text):
        """Answers of a reset and ten steps in an environment of its own."""
        signal.alarm(PATIENCE_S)
        try:
            environment = self.make()
            rows = self.ten_steps(environment, struct.unpack("<Q", text)[0], True)
            environment.close()
        except Exception as error:
            if not is_of_an_import(error):
                raise
            return b"n", refusal(error, self.lock, self.interpreter)
        finally:
            signal.alarm(0)
        return b"k", b"".join(rows)

    def ten_steps(self, environment, seed, begins):
        """Answers of ten steps with drawn actions, with a reset where an episode begins."""
        import numpy

        random, rows, standing = numpy.random.default_rng(seed), [], TERMINATED if begins else GOING_ON
        for _ in range(REHEARSED_STEPS):
            if standing != GOING_ON:
                row = numpy.zeros(self.kind.answered)
                self.kind.reset(environment, seed, row)
                rows.append(row.tobytes())
            row = numpy.zeros(self.kind.answered)
            self.kind.step(environment, numpy.array(self.kind.draw(random)), row)
            rows.append(row.tobytes())
            standing = row[0]
        return rows

    def snapshot(self, text):
        """An environment as bytes from which it continues alike, or why there are none."""
        slot = struct.unpack("<Q", text)[0]
        environment = self.environments[slot]
        try:
            state = pickle.dumps((environment, slot in self.ended))
        except Exception as error:
            return b"n", f"it cannot be pickled: {told(error)}".encode()
        if not self.continues_alike(environment, state):
            return b"n", b"what is unpickled of it does not continue as it does itself"
        return b"k", state

    def continues_alike(self, environment, state):
        """Tried in a copy of this process, so that the environment itself goes on untouched."""
        reader, writer = os.pipe()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            child = os.fork()
        if child == 0:
            die_with_parent()
            try:
                copy, ended = pickle.loads(state)
                one, other = self.outcome(environment, ended), self.outcome(copy, ended)
                os.write(writer, b"y" if one == other else b"n")
            finally:
                os._exit(0)
        os.close(writer)
        is_there, _, _ = select.select([reader], [], [], PATIENCE_S)
        answer = os.read(reader, 1) if is_there else b""
        os.close(reader)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return answer == b"y"

    def outcome(self, environment, begins):
        try:
            return self.ten_steps(environment, 1, begins)
        except Exception as error:
            return repr(error)

    def restore(self, text):
        slot = struct.unpack("<Q", text[:8])[0]
        self.close(slot)
        self.environments[slot], ended = pickle.loads(text[8:])
        (self.ended.add if ended else self.ended.discard)(slot)
        return b"k", b""

    def serve(self):
        commands = {b"t": self.rehearse, b"p": self.snapshot, b"r": self.restore}
        while byte := self.link.byte():
            text = None if byte == b"s" else self.link.text()
            try:
                answer = (b"k", None) if text is None else commands[byte](text)
                if text is None:
                    self.answer_requests()
            except Exception as error:
                answer = b"e", told(error).encode()
            self.link.say(*answer)
        for slot in list(self.environments):
            self.close(slot)


def shared_memory(size):
    """A handle, a path by which the other side opens the same, and whether the path is a file to be removed."""
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("regimen")
        path, remove = f"/proc/{os.getpid()}/fd/{handle}", False
    else:
        import tempfile

        (handle, path), remove = tempfile.mkstemp(prefix="regimen-"), True
    os.ftruncate(handle, size)
    return handle, path, remove


def main():
    # A signal to the whole group of processes is not ours to answer.
    for name in ("SIGINT", "SIGTERM", "SIGUSR1"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    # The folder in which the program runs is no part of the environment's sources.
    sys.path[:] = [path for path in sys.path if path]
    signal.alarm(PATIENCE_S)
    link = Link()
    end_with_parent(link.reader)
    asked = json.loads(link.text())
    try:
        server = Server(link, asked)
    except Exception as error:
        link.say(b"e", refusal(error, asked["lock"], asked["interpreter"]))
        os._exit(1)
    signal.alarm(0)
    link.say(b"k", json.dumps(server.face()).encode())
    try:
        server.serve()
    except SystemExit as left:
        # Told as an exit code: an environment may leave, but not to be followed by another one.
        os._exit(left.code if isinstance(left.code, int) else 1)
    os._exit(0)


main()
