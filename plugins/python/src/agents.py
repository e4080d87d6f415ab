

# --- A rule or a learner -------------------------------------------------------------------------------------


class Batch:
    """Transitions in arrays, a row each; with several seats, dictionaries of arrays by seat."""

    def __init__(self, observation, action, reward, next_observation, terminated, truncated):
        self.observation, self.action, self.reward = observation, action, reward
        self.next_observation, self.terminated, self.truncated = next_observation, terminated, truncated


class OwnSeat:
    """The observation and the action of a seat, and the position of its numbers in a row."""

    def __init__(self, form, is_only, seen, done):
        self.name, whose = form["name"], "" if is_only else f" for seat `{form['name']}`"
        self.names, self.limits = form["observation"]["names"], form["observation"]["limits"]
        self.action = ACTIONS[form["action"]["kind"]](form["action"], whose)
        self.seen, self.done = slice(seen, seen + len(self.names)), slice(done, done + self.action.size)

    def observation_space(self, spaces):
        import numpy

        low = numpy.array([-numpy.inf if low is None else low for low, _ in self.limits])
        high = numpy.array([numpy.inf if high is None else high for _, high in self.limits])
        return spaces.Box(low, high, (len(self.names),), float)


class OwnAgent:
    """An agent of the user, and the calls of its methods."""

    def __init__(self, asked):
        hold_against_lock(asked["lock"], asked["interpreter"], "numpy")
        call, told = found_module(asked, ["numpy"]), asked["agent"]
        self.seats = []
        for form in told["seats"]:
            before = self.seats[-1] if self.seats else None
            places = (before.seen.stop, before.done.stop) if before else (0, 0)
            self.seats.append(OwnSeat(form, len(told["seats"]) == 1, *places))
        self.observed, self.asked = self.seats[-1].seen.stop, self.seats[-1].done.stop
        self.metrics = told["metrics"]
        self.agent = call(**asked["arguments"], **self.given(call, asked))
        self.name = type(self.agent).__name__
        self.several = callable(getattr(self.agent, "act_batch", None))
        self.refuse(told["learns"])
        self.act_of = self.method("act_batch" if self.several else "act")
        self.learn_of = self.method("learn") if told["learns"] else None

    def given(self, call, asked):
        """The arguments in addition to those of the study: all that the function has as named parameters."""
        makers = {
            "seed": lambda: asked["agent"]["seed"],
            "seats": lambda: [seat.name for seat in self.seats],
            "observation_names": lambda: self.by_seat(lambda seat: seat.names),
            "action_names": lambda: self.by_seat(lambda seat: seat.action.names),
            "observation_space": lambda: self.by_seat(lambda seat: seat.observation_space(gymnasium_of(asked).spaces)),
            "action_space": lambda: self.by_seat(lambda seat: seat.action.space(gymnasium_of(asked).spaces)),
        }
        for name in sorted(set(makers) & set(asked["arguments"])):
            raise Refused("arguments", f"`{name}` is what every agent can ask for: give this argument another name")
        wanted = names_of_parameters(call)
        return {name: maker() for name, maker in makers.items() if name in wanted}

    def refuse(self, learns):
        has = {name: callable(getattr(self.agent, name, None)) for name in ("act", "learn", "save", "load", "restart")}
        what = f"`{self.name}`"
        if not has["act"] and not self.several:
            raise Refused("make", f"what it makes is of type {self.name}, which has neither `act` nor `act_batch`")
        if learns and not has["learn"]:
            raise Refused("learns", f"it is true, and {what} has no `learn`: add one, or leave out `learns`")
        if has["learn"] and not learns:
            raise Refused(
                "learns", f"{what} has a `learn`, which nobody calls: write `learns: true`, so that protocols train it"
            )
        if has["save"] != has["load"]:
            there, missing = ("save", "load") if has["save"] else ("load", "save")
            raise Refused("make", f"{what} has `{there}` and no `{missing}`: an agent goes on by both, or has neither")
        if learns and has["restart"]:
            raise Refused(
                "make", f"{what} has `restart`, and learns: several episodes go on at a time then, so that it cannot remember one"
            )
        self.saves, self.restarts = has["save"], has["restart"]

    def face(self):
        return {"saves": self.saves, "restarts": self.restarts}

    def by_seat(self, of):
        """The value for a single seat, or a dictionary by name for several."""
        if len(self.seats) == 1:
            return of(self.seats[0])
        return {seat.name: of(seat) for seat in self.seats}

    def method(self, name):
        """A method, its name in messages, and its named parameters after the first argument."""
        method = getattr(self.agent, name)
        code = getattr(method, "__code__", None)
        where = f" ({os.path.basename(code.co_filename)}, line {code.co_firstlineno})" if code else ""
        return method, f"`{name}` of `{self.name}`{where}", names_of_parameters(method)

    def act(self, text):
        import numpy

        numbers = numpy.frombuffer(text, "<f8")
        rows = numbers[2:].reshape(-1, self.observed)
        method, where, wanted = self.act_of
        more = more_of(wanted, explore=bool(numbers[0]), rng=int(numbers[1]))
        answers = numpy.zeros((len(rows), self.asked))
        if self.several:
            self.write(method(self.seen(rows), **more), len(rows), where, answers)
        else:
            for row, answer in zip(rows, answers):
                self.write(method(self.seen(row), **more), None, where, answer[None])
        return b"k", answers.tobytes()

    def seen(self, rows):
        """Observations as copies, which the receiver may change."""
        return self.by_seat(lambda seat: rows[..., seat.seen].copy())

    def write(self, returned, n, where, rows):
        if len(self.seats) == 1:
            return self.seats[0].action.write(returned, n, where, rows)
        names = ", ".join(repr(seat.name) for seat in self.seats)
        if not isinstance(returned, dict) or any(seat.name not in returned for seat in self.seats):
            raise ValueError(f"{where} returned {in_words(returned)} in place of a dictionary with {names}")
        for seat in self.seats:
            seat.action.write(returned[seat.name], n, where, rows[:, seat.done])

    def learn(self, text):
        import numpy

        numbers = numpy.frombuffer(text, "<f8")
        seen, done, seats = self.observed, self.asked, len(self.seats)
        rows = numbers[1:].reshape(-1, 2 * seen + done + seats + 1)
        actions, rewards = rows[:, seen : seen + done], rows[:, seen + done : seen + done + seats]
        batch = Batch(
            self.seen(rows[:, :seen]),
            self.by_seat(lambda seat: seat.action.read(actions[:, seat.done])),
            self.by_seat(lambda seat: rewards[:, self.seats.index(seat)].copy()),
            self.seen(rows[:, seen + done + seats : -1]),
            rows[:, -1] == TERMINATED,
            rows[:, -1] == TRUNCATED,
        )
        method, where, wanted = self.learn_of
        returned = method(batch, **more_of(wanted, rng=int(numbers[0])))
        return b"k", numpy.array([self.updates(), *self.recorded(returned, where)]).tobytes()

    def updates(self):
        """The number of its updates if it counts them itself; otherwise -1."""
        updates = getattr(self.agent, "updates", None)
        return -1.0 if updates is None or callable(updates) else number(updates, f"`updates` of `{self.name}`")

    def recorded(self, returned, where):
        """For each metric, whether it was returned, and its value."""
        returned = {} if returned is None else returned
        if not isinstance(returned, dict):
            raise ValueError(f"{where} returned {in_words(returned)} in place of None or a dictionary of numbers by name")
        for name in returned:
            if name not in self.metrics:
                known = ", ".join(sorted({*self.metrics, str(name)}))
                raise ValueError(f"{where} returned `{name}`, which the study does not name: write `metrics: [{known}]`")
        for name in self.metrics:
            yield float(name in returned)
            yield number(returned[name], f"`{name}` of what {where} returned") if name in returned else 0.0

    def save(self, _):
        saved = self.agent.save()
        if not isinstance(saved, (bytes, bytearray)):
            raise ValueError(f"{self.method('save')[1]} returned {in_words(saved)} in place of bytes, as pickle.dumps makes them")
        return b"k", bytes(saved)

    def load(self, text):
        self.agent.load(text)
        return b"k", b""

    def restart(self, _):
        self.agent.restart()
        return b"k", b""

    def commands(self):
        return {b"a": self.act, b"l": self.learn, b"p": self.save, b"r": self.load, b"x": self.restart}

    def end(self):
        pass


def names_of_parameters(call):
    import inspect

    try:
        return set(inspect.signature(call).parameters)
    except (TypeError, ValueError):
        return set()


def more_of(wanted, rng, **more):
    """The named arguments of a method: a generator of the trial's stream, and the others unchanged."""
    if "rng" in wanted:
        import numpy

        more["rng"] = numpy.random.default_rng(rng)
    return {name: value for name, value in more.items() if name in wanted}


def gymnasium_of(asked):
    hold_against_lock(asked["lock"], asked["interpreter"], "gymnasium")
    import gymnasium

    return gymnasium
