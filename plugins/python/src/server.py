

# --- Environments of a trial ------------------------------------------------------------------------------------

# Number of blocks in the shared memory, after the list of their requests.
MOST_ENVIRONMENTS = 8192
# Kinds of request.
STEP, RESET, RENEW = 1, 2, 3
# State of an episode.
GOING_ON, TERMINATED, TRUNCATED = 0, 1, 2
# Steps of a rehearsal, and the time limit of a copy for them.
REHEARSED_STEPS = 10
PATIENCE_S = 300
# Steps after which an unfinished episode gets a remark, if they take no longer than this time.
MANY_STEPS, MANY_STEPS_S = 10_000, 2.0


class Server:
    """The environments of one trial."""

    def __init__(self, asked):
        self.lock, self.interpreter = asked["lock"], asked["interpreter"]
        hold_against_lock(self.lock, self.interpreter, "gymnasium")
        call = found_module(asked, ["gymnasium", "numpy"])
        import mmap

        import numpy

        self.make = lambda: call(**asked["arguments"])
        first = self.make()
        self.kind = kind_of(first, asked["metrics"])
        self.environments, self.ended, self.first_is_new = {0: first}, set(), True
        length = 2 + self.kind.asked + self.kind.answered
        size = 8 * (1 + MOST_ENVIRONMENTS + MOST_ENVIRONMENTS * length)
        handle, self.path, self.remove = shared_memory(size)
        self.memory = mmap.mmap(handle, size)
        self.requests = numpy.ndarray(1 + MOST_ENVIRONMENTS, "<i8", self.memory)
        blocks = (MOST_ENVIRONMENTS, length)
        self.blocks = numpy.ndarray(blocks, "<f8", self.memory, self.requests.nbytes)

    def face(self):
        return {"memory": self.path, "remove": self.remove, **self.kind.face()}

    def answer_requests(self):
        """Carries out the requests in shared memory, for all waiting environments."""
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
        """A new environment, which nothing that happened to another one can influence."""
        if self.first_is_new and slot == 0:
            # The first environment is still new: it was made only to read its spaces.
            self.first_is_new = False
            return
        self.close(slot)
        self.environments[slot] = self.make()

    def close(self, slot):
        if slot in self.environments:
            self.environments.pop(slot).close()

    def rehearse(self, text):
        """Answers to a reset and ten steps in a new environment."""
        try:
            environment = self.make()
            rows = self.ten_steps(environment, struct.unpack("<Q", text)[0], True)
            environment.close()
        except Exception as error:
            if not is_of_an_import(error):
                raise
            return b"n", refusal(error, self.lock, self.interpreter)
        return b"k", b"".join(rows)

    def doubt(self, text):
        """Usable results that differ from the declaration, a line each, in a further rehearsal up to the end of an
        episode."""
        self.kind.doubts = {}
        environment = self.make()
        rows = self.ten_steps(environment, struct.unpack("<Q", text)[0], True)
        doubts = list(self.kind.doubts.values())
        self.kind.doubts = None
        if not self.ends(environment, rows):
            doubts.append(
                f"an episode had not ended after {MANY_STEPS} steps with drawn actions: where nothing cuts it off, a "
                "measurement can go on for ever (gymnasium.wrappers.TimeLimit, or `max_episode_steps` among the arguments)"
            )
        environment.close()
        return b"k", "\n".join(doubts).encode()

    def ends(self, environment, rows):
        """Whether an episode ends within many steps, if that can be found in a short time."""
        import numpy

        if any(numpy.frombuffer(row)[0] != GOING_ON for row in rows):
            return True
        random, row, until = numpy.random.default_rng(1), numpy.zeros(self.kind.answered), time.monotonic() + MANY_STEPS_S
        for _ in range(MANY_STEPS):
            self.kind.step(environment, numpy.array(self.kind.draw(random)), row)
            if row[0] != GOING_ON or time.monotonic() > until:
                return True
        return False

    def ten_steps(self, environment, seed, begins):
        """Answers to ten steps with random actions, with a reset at the start of an episode."""
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
        """An environment as bytes from which it continues identically, or the reason why there are none."""
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
        """Tests it in a copy of this process, so that the environment itself stays unchanged."""
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

    def commands(self):
        return {b"t": self.rehearse, b"d": self.doubt, b"p": self.snapshot, b"r": self.restore}

    def end(self):
        for slot in list(self.environments):
            self.close(slot)


def shared_memory(size):
    """A handle, the path for the other side, and whether the path is a file to be removed."""
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("regimen")
        path, remove = f"/proc/{os.getpid()}/fd/{handle}", False
    else:
        import tempfile

        (handle, path), remove = tempfile.mkstemp(prefix="regimen-"), True
    os.ftruncate(handle, size)
    return handle, path, remove
