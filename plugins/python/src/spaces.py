

# --- Spaces as numbers ---------------------------------------------------------------------------------------


# Tolerance for an entry outside its limits: the last bits of single precision.
ROUNDING = 1e-6


def refuse_space(space, place, instead):
    raise Refused("make", f"{place} is a space of kind {type(space).__name__}, which is not supported: {instead}")


class BoxNumbers:
    """A box entry by entry; an action has its entries within -1 and 1."""

    def __init__(self, space, name, place, is_action):
        import numpy

        self.size, self.shape, self.dtype = int(numpy.prod(space.shape)), space.shape, space.dtype
        self.place, self.bounds, self.choices = place, (space.low, space.high), None
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
        # Rounding is monotone, so only limits that are not met exactly can be exceeded.
        exact = (self.middle + self.half == high).all() and (self.middle - self.half == low).all()
        self.limits = None if exact else (low, high)

    def write(self, value, row):
        import numpy

        try:
            entries = numpy.asarray(value)
        except ValueError as error:
            raise ValueError(f"{self.place} is {in_words(value)} in place of numbers: {error}") from error
        if entries.dtype.kind not in "biuf":
            raise ValueError(f"{self.place} is {in_words(value)} in place of numbers")
        if entries.size != self.size:
            raise ValueError(
                f"{self.place} has {entries.size} entries in place of {self.size}: it has the shape {entries.shape}, the "
                f"space {self.shape}"
            )
        row[:] = entries.reshape(-1)

    def doubts(self, value, row):
        """Usable values that differ from the space."""
        import numpy

        if getattr(value, "shape", self.shape) != self.shape:
            yield f"{self.place} has the shape {value.shape}, its space {self.shape}"
        if not hasattr(value, "dtype"):
            yield f"{self.place} is {in_words(value)} in place of an array"
        elif not numpy.can_cast(value.dtype, self.dtype):
            yield f"{self.place} is of {value.dtype}, its space of {self.dtype}"
        low, high = (numpy.asarray(limit, dtype=float).reshape(-1) for limit in self.bounds)
        outside = numpy.flatnonzero((row < low - ROUNDING * abs(low)) | (row > high + ROUNDING * abs(high)))
        if outside.size:
            at = int(outside[0])
            name = self.channels[at]["name"]
            yield f"`{name}` of {self.place} is {row[at]}, outside its space, {low[at]} to {high[at]}"

    def read(self, row):
        value = self.middle + row * self.half
        if self.limits is not None:
            value = value.clip(*self.limits)
        return value.reshape(self.shape).astype(self.dtype)

    def draw(self, random):
        return random.uniform(-1.0, 1.0, self.size)


class ChoiceNumbers:
    """Choices among options: the index of each in an action, one number per option in an observation, 1 for the
    chosen one."""

    def __init__(self, counts, starts, name, place, is_action, is_one):
        self.counts, self.starts, self.place, self.is_one = counts, starts, place, is_one
        names = [name] if is_one else [f"{name}_{index}" for index in range(len(counts))]
        options = [[str(start + at) for at in range(count)] for count, start in zip(counts, starts)]
        self.choices = [{"name": it, "options": among} for it, among in zip(names, options)]
        each = [(it["name"], option) for it in self.choices for option in it["options"]]
        self.channels = [{"name": f"{it}_{option}", "low": 0.0, "high": 1.0} for it, option in each]
        self.size = len(counts) if is_action else len(self.channels)

    def write(self, value, row):
        import numpy

        row[:] = 0.0
        taken = numpy.asarray(value).reshape(-1)
        is_whole = taken.dtype.kind in "biu" or taken.dtype.kind == "f" and (taken == numpy.floor(taken)).all()
        if not is_whole or taken.size != len(self.counts):
            wanted = "a whole number" if self.is_one else f"{len(self.counts)} whole numbers"
            raise ValueError(f"{self.place} is {in_words(value)} in place of {wanted}")
        first = 0
        for index, count, start in zip(taken.astype(int).tolist(), self.counts, self.starts):
            if not start <= index < start + count:
                raise ValueError(f"{self.place} is {value}, which is none of {start} to {start + count - 1}")
            row[first + index - start] = 1.0
            first += count

    def doubts(self, value, row):
        if not hasattr(value, "dtype") and isinstance(value, float):
            yield f"{self.place} is {in_words(value)} in place of a whole number"

    def read(self, row):
        import numpy

        taken = [int(index) + start for index, start in zip(row, self.starts)]
        return taken[0] if self.is_one else numpy.array(taken, dtype=self.dtype).reshape(self.shape)

    def draw(self, random):
        return [float(random.integers(count)) for count in self.counts]


def discrete(space, name, place, is_action):
    return ChoiceNumbers([int(space.n)], [int(space.start)], name, place, is_action, True)


def multi_discrete(space, name, place, is_action):
    counts, starts = space.nvec.reshape(-1).tolist(), space.start.reshape(-1).tolist()
    numbers = ChoiceNumbers(counts, starts, name, place, is_action, False)
    numbers.shape, numbers.dtype = space.shape, space.dtype
    return numbers


class DictNumbers:
    """The entries of a dictionary one after the other."""

    def __init__(self, place, parts):
        self.place, self.parts, self.channels, self.size = place, [], [], 0
        for key, part in parts:
            self.parts.append((key, part, slice(self.size, self.size + part.size)))
            self.channels += part.channels
            self.size += part.size
        of_parts = [part.choices for _, part in parts]
        self.choices = None if None in of_parts else [choice for choices in of_parts for choice in choices]

    def write(self, value, row):
        for key, part, at in self.parts:
            try:
                entry = value[key]
            except (KeyError, TypeError, IndexError):
                raise ValueError(f"{part.place} is not in {in_words(value)}") from None
            part.write(entry, row[at])

    def doubts(self, value, row):
        for key, part, at in self.parts:
            yield from part.doubts(value[key], row[at])

    def read(self, row):
        return {key: part.read(row[at]) for key, part, at in self.parts}

    def draw(self, random):
        return [number for _, part, _ in self.parts for number in part.draw(random)]


def numbers_of(space, place, is_action, name=None):
    from gymnasium import spaces

    word = "action" if is_action else "observation"
    if isinstance(space, spaces.Box):
        return BoxNumbers(space, name or word, place, is_action)
    if isinstance(space, spaces.Discrete):
        return discrete(space, name or word, place, is_action)
    if isinstance(space, spaces.MultiDiscrete):
        return multi_discrete(space, name or word, place, is_action)
    if isinstance(space, spaces.Dict):
        below = [(key, f"{name}_{key}" if name else str(key)) for key in space.spaces]
        parts = [(key, numbers_of(space[key], f"{place}[{key!r}]", is_action, it)) for key, it in below]
        if is_action and len({part.choices is None for _, part in parts}) > 1:
            raise Refused("make", f"{place} has boxes beside choices, which is not supported: let all entries be of one kind")
        return with_names_of_their_own(DictNumbers(place, parts), place)
    instead = "a box (with limits), choices (Discrete, MultiDiscrete) or a dictionary of these is wanted, for example by "
    instead += "gymnasium.wrappers." + ("TransformAction" if is_action else "FlattenObservation")
    refuse_space(space, place, instead)


def with_names_of_their_own(numbers, place):
    names = [channel["name"] for channel in numbers.channels]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise Refused("make", f"{place} has two entries called {', '.join(twice)}: rename a key of the dictionary")
    return numbers


def finite(limit):
    """A limit; `None` without one, or for the largest numbers of single precision, which mean no limit."""
    return limit if abs(limit) < 1e30 else None


def form(numbers, is_action):
    if is_action and numbers.choices is not None:
        return {"choices": numbers.choices}
    return {"box": numbers.channels}


def in_words(value):
    """A returned value, as messages describe it."""
    import numpy

    if isinstance(value, numpy.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and type {value.dtype}"
    if isinstance(value, (tuple, list)):
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, dict):
        return f"a dictionary with {', '.join(map(repr, list(value)[:5])) or 'nothing'}"
    text = repr(value)
    return f"{text if len(text) < 60 else '...'} ({type(value).__name__})"
