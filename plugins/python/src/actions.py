

# --- Actions of agents ---------------------------------------------------------------------------------------

# Tolerance for the sum of shares, the same as in the checks of environments.
SUM_ROUNDING = 1e-6


class BoxAction:
    """Numbers within limits: those of the environment itself if it has other limits than -1 and 1."""

    def __init__(self, form, whose):
        import numpy

        self.whose, self.names, self.size = whose, form["names"], len(form["names"])
        scaled = [own is not None for own in form["own"]]
        limits = [own or given for own, given in zip(form["own"], form["limits"])]
        self.low = numpy.array([-numpy.inf if low is None else low for low, _ in limits])
        self.high = numpy.array([numpy.inf if high is None else high for _, high in limits])
        width = numpy.where(scaled, self.high - self.low, 2.0)
        self.middle, self.half = numpy.where(scaled, (self.low + self.high) / 2, 0.0), numpy.where(width > 0, width, 2.0) / 2
        self.rounding = ROUNDING * numpy.where(numpy.isfinite(width), self.half, 1.0)
        self.one = "a number" if self.size == 1 else f"{self.size} numbers"
        self.shape = (self.size,)

    def write(self, value, n, where, rows):
        """Takes the value of one action, or of `n`, into rows."""
        import numpy

        entries = entries_of(self, value, n, where).astype(float)
        # The program that asked reports numbers that are not finite.
        outside = numpy.argwhere((entries < self.low - self.rounding) | (entries > self.high + self.rounding))
        if outside.size:
            row, at = outside[0]
            raise ValueError(
                f"{where} returned {entries[row, at]:.6g} for `{self.names[at]}`{self.whose}, outside {self.low[at]:.6g} "
                f"to {self.high[at]:.6g}"
            )
        rows[:] = (entries.clip(self.low, self.high) - self.middle) / self.half

    def read(self, rows):
        return (self.middle + rows * self.half).clip(self.low, self.high)

    def space(self, spaces):
        return spaces.Box(self.low, self.high, self.shape, float)


class ShareAction:
    """Shares that are not negative and sum to 1."""

    def __init__(self, form, whose):
        self.whose, self.names, self.size = whose, form["names"], len(form["names"])
        self.one, self.shape = f"{self.size} shares that sum to 1", (self.size,)

    def write(self, value, n, where, rows):
        import numpy

        entries = entries_of(self, value, n, where).astype(float)
        if (entries < 0).any():
            raise ValueError(f"{where} returned the share {entries.min():.6g}{self.whose}: shares are not negative")
        sums = entries.sum(axis=1)
        # The program that asked reports a sum that is not a number.
        wrong = numpy.flatnonzero(abs(sums - 1) > SUM_ROUNDING)
        if wrong.size:
            raise ValueError(f"{where} returned shares that sum to {sums[wrong[0]]:.9g}{self.whose}: they sum to 1")
        rows[:] = entries

    def read(self, rows):
        return rows.copy()

    def space(self, spaces):
        return spaces.Box(0.0, 1.0, self.shape, float)


class OptionAction:
    """One choice or several, each an option by its number or its name. If the names of options are consecutive whole
    numbers, these are also their numbers."""

    def __init__(self, form, whose):
        self.whose, self.choices = whose, form["choices"]
        self.options = [choice["options"] for choice in self.choices]
        self.names = self.options[0] if len(self.options) == 1 else self.options
        self.size, self.starts = len(self.choices), [start_of(options) for options in self.options]
        self.is_one = self.size == 1
        self.one = "the number or the name of an option" if self.is_one else f"{self.size} numbers or names of options"
        self.shape = () if self.is_one else (self.size,)

    def write(self, value, n, where, rows):
        entries = entries_of(self, value, n, where, "biufUO")
        for row, taken in zip(rows, entries):
            row[:] = [self.position(at, it, where) for at, it in enumerate(taken.tolist())]

    def position(self, at, taken, where):
        options, start = self.options[at], self.starts[at]
        if isinstance(taken, str) and taken in options:
            return options.index(taken)
        if isinstance(taken, (int, float)):
            if taken != taken:
                return taken
            if float(taken).is_integer() and 0 <= taken - start < len(options):
                return int(taken) - start
        known = ", ".join(f"{start + place} ({it})" if str(start + place) != it else it for place, it in enumerate(options[:20]))
        name = self.choices[at]["name"]
        raise ValueError(f"{where} returned {in_words(taken)} for `{name}`{self.whose}; its options are {known}")

    def read(self, rows):
        import numpy

        taken = rows.astype(int) + numpy.array(self.starts)
        return taken[:, 0] if self.is_one else taken

    def space(self, spaces):
        counts = [len(options) for options in self.options]
        if self.is_one:
            return spaces.Discrete(counts[0], start=self.starts[0])
        import numpy

        return spaces.MultiDiscrete(counts, start=numpy.array(self.starts))


def start_of(options):
    """The number of the first option."""
    try:
        start = int(options[0])
    except ValueError:
        return 0
    return start if options == [str(start + at) for at in range(len(options))] else 0


def entries_of(action, value, n, where, kinds="biuf"):
    """The entries of one action, or of `n`, a row each."""
    import numpy

    try:
        entries = numpy.asarray(value)
        is_right = entries.dtype.kind in kinds and entries.size == (n or 1) * action.size
    except ValueError:
        is_right = False
    if not is_right or n is not None and entries.shape[:1] != (n,):
        several = f"an array of shape {(n, *action.shape)}, a row for each observation: {action.one} in each"
        raise ValueError(f"{where} returned {in_words(value)}{action.whose} in place of {action.one if n is None else several}")
    return entries.reshape(-1, action.size)


ACTIONS = {"box": BoxAction, "simplex": ShareAction, "choices": OptionAction}
