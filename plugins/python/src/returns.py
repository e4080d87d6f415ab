

# --- Environments, and what they return ----------------------------------------------------------------------


class Metrics:
    """Entries of `info` that the study takes as metrics, by name, with their reduction over an episode."""

    def __init__(self, taken):
        self.taken, self.size = sorted(taken.items()), len(taken)

    def write(self, info, whose, has_ended, row):
        for at, (name, how) in enumerate(self.taken):
            if name in info:
                row[at] = number(info[name], f"`{name}` of {whose}")
            elif how == "last" and not has_ended:
                # Only the last step counts.
                row[at] = 0.0
            else:
                known = ", ".join(map(str, info)) or "nothing"
                raise ValueError(f"`metrics` takes `{name}`, and {whose} has {known}")


def number(value, place):
    """A number as Gymnasium accepts it: of Python or numpy, possibly in an array of one entry."""
    if type(value) is float:
        return value
    import numpy

    try:
        entries = numpy.asarray(value)
    except ValueError:
        entries = numpy.asarray(None)
    if entries.dtype.kind not in "biuf" or entries.size != 1:
        raise ValueError(f"{place} is {in_words(value)} in place of a number (float, int, numpy.floating, numpy.integer)")
    return float(entries.reshape(-1)[0])


def truth(value, place):
    import numpy

    if isinstance(value, (bool, numpy.bool_)) or getattr(value, "dtype", None) == bool and value.size == 1:
        return bool(value)
    raise ValueError(f"{place} is {in_words(value)} in place of True or False")


def note(known, doubts):
    """Keeps the first doubt of each kind."""
    for doubt in doubts:
        known.setdefault(doubt.partition(" is ")[0], doubt)


def pair_of(returned, what):
    """The checked result of `reset`."""
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise ValueError(
            f"reset returned no pair of {what[0]} and {what[1]}, but {in_words(returned)}: since version "
            f"{what[2]} both are returned"
        )
    return returned


def five_of(returned, names):
    """The checked result of `step`."""
    if not isinstance(returned, tuple) or len(returned) != 5:
        found = f"{len(returned)} values" if isinstance(returned, (tuple, list)) else in_words(returned)
        raise ValueError(f"step returned {found} in place of {names}")
    return returned


def dictionary(value, place):
    if not isinstance(value, dict):
        raise ValueError(f"{place} is {in_words(value)} in place of a dictionary")
    return value


class Single:
    """Starts and steps an environment of Gymnasium."""

    def __init__(self, environment, metrics):
        self.observation = numbers_of(environment.observation_space, "the observation", False)
        self.action = numbers_of(environment.action_space, "the action", True)
        self.metrics, self.after = Metrics(metrics), 2 + self.observation.size
        self.asked, self.answered = self.action.size, self.after + self.metrics.size
        # Doubts about usable results, which only a rehearsal collects.
        self.doubts = None

    def face(self):
        action = form(self.action, True)
        seats = [{"name": "", "observation": form(self.observation, False), "action": action}]
        return {"seats": seats, "state": [], "metrics": [name for name, _ in self.metrics.taken]}

    def reset(self, environment, seed, row):
        observation, info = pair_of(environment.reset(seed=seed), ("observation", "info", "0.26 of Gymnasium"))
        dictionary(info, "the info of reset")
        self._see(observation, row)
        row[0], row[1], row[self.after :] = GOING_ON, 0.0, 0.0

    def step(self, environment, asked, row):
        names = "observation, reward, terminated, truncated, info"
        returned = environment.step(self.action.read(asked))
        observation, reward, terminated, truncated, info = five_of(returned, names)
        row[1] = number(reward, "the reward")
        terminated, truncated = truth(terminated, "terminated"), truth(truncated, "truncated")
        row[0] = TERMINATED if terminated else TRUNCATED if truncated else GOING_ON
        self._see(observation, row)
        info = dictionary(info, "the info of step")
        self.metrics.write(info, "the info of step", row[0] != GOING_ON, row[self.after :])

    def _see(self, observation, row):
        self.observation.write(observation, row[2 : self.after])
        if self.doubts is not None:
            note(self.doubts, self.observation.doubts(observation, row[2 : self.after]))

    def draw(self, random):
        return self.action.draw(random)


class Parallel:
    """Starts and steps an environment of PettingZoo's parallel interface, with a seat for each agent."""

    def __init__(self, environment, metrics):
        self.agents = list(environment.possible_agents)
        of = "the {} of agent {!r}"
        self.observations = [
            numbers_of(environment.observation_space(agent), of.format("observation", agent), False)
            for agent in self.agents
        ]
        self.actions = [
            numbers_of(environment.action_space(agent), of.format("action", agent), True) for agent in self.agents
        ]
        self.state, self.metrics = state_of(environment), Metrics(metrics)
        self.asked = sum(action.size for action in self.actions)
        self.first = 1 + len(self.agents)
        self.of_state = self.first + sum(observation.size for observation in self.observations)
        self.of_metrics = self.of_state + (self.state.size if self.state else 0)
        self.answered = self.of_metrics + len(self.agents) * self.metrics.size
        self.doubts = None

    def face(self):
        each = zip(self.agents, self.observations, self.actions)
        seats = [
            {"name": str(it), "observation": form(seen, False), "action": form(done, True)} for it, seen, done in each
        ]
        state = self.state.channels if self.state else []
        names = [f"{agent}_{name}" for agent in self.agents for name, _ in self.metrics.taken]
        return {"seats": seats, "state": state, "metrics": names}

    def reset(self, environment, seed, row):
        returned = pair_of(environment.reset(seed=seed), ("observations", "infos", "1.23 of PettingZoo"))
        self._all_are_there(environment, "after reset")
        row[: self.first], row[self.of_metrics :] = 0.0, 0.0
        self._see(environment, dictionary(returned[0], "what reset returns as observations"), row)

    def step(self, environment, asked, row):
        actions, at = {}, 0
        for agent, action in zip(self.agents, self.actions):
            actions[agent] = action.read(asked[at : at + action.size])
            at += action.size
        names = ["observations", "rewards", "terminations", "truncations", "infos"]
        returned = five_of(environment.step(actions), ", ".join(names))
        observations, rewards, terminations, truncations, infos = map(self._of_agents, returned, names)
        row[0] = self._standing(environment, terminations, truncations)
        row[1 : self.first] = [number(rewards[it], f"the reward of agent {it!r}") for it in self.agents]
        self._see(environment, observations, row)
        at = self.of_metrics
        for agent in self.agents if self.metrics.size else ():
            whose = f"the info of agent {agent!r}"
            info = dictionary(infos[agent], whose)
            self.metrics.write(info, whose, row[0] != GOING_ON, row[at : at + self.metrics.size])
            at += self.metrics.size

    def _of_agents(self, returned, name):
        dictionary(returned, f"what step returns as {name}")
        has_all = hasattr(type(returned), "__missing__")
        missing = [agent for agent in self.agents if agent not in returned and not has_all]
        if missing and (name != "infos" or self.metrics.size):
            raise ValueError(f"step returned {name} without {', '.join(map(repr, missing))}")
        return returned

    def _standing(self, environment, terminations, truncations):
        ends = [
            (truth(terminations[it], f"the termination of {it!r}"), truth(truncations[it], f"the truncation of {it!r}"))
            for it in self.agents
        ]
        left = [terminated or truncated for terminated, truncated in ends]
        if not any(left):
            self._all_are_there(environment, "while nobody has ended")
            return GOING_ON
        if not all(left):
            gone = [agent for agent, ended in zip(self.agents, left) if ended]
            raise ValueError(
                f"{', '.join(map(str, gone))} left before the others, which is not supported: let agents stay to "
                "the end with observations of zeros, as black_death_v3 of SuperSuit does"
            )
        return TERMINATED if all(terminated for terminated, _ in ends) else TRUNCATED

    def _all_are_there(self, environment, when):
        missing = [agent for agent in self.agents if agent not in environment.agents]
        if missing:
            raise ValueError(
                f"{', '.join(map(str, missing))} of the possible agents is missing {when}, which is not supported"
            )

    def _see(self, environment, observations, row):
        at = self.first
        for agent, observation in zip(self.agents, self.observations):
            own = row[at : at + observation.size]
            if agent not in observations:
                raise ValueError(f"{observation.place} is not in {in_words(observations)}")
            observation.write(observations[agent], own)
            if self.doubts is not None:
                note(self.doubts, observation.doubts(observations[agent], own))
            at += observation.size
        if self.state:
            self.state.write(environment.state(), row[self.of_state : self.of_metrics])

    def draw(self, random):
        return [number for action in self.actions for number in action.draw(random)]


# Larger full states are images of the scene, which no mixer here reads.
MOST_OF_STATE = 10_000


def state_of(environment):
    """The numbers of the full state; `None` if the environment declares no usable one."""
    from gymnasium import spaces

    space = getattr(environment, "state_space", None)
    if not isinstance(space, spaces.Space) or not hasattr(environment, "state"):
        return None
    try:
        numbers = numbers_of(space, "the state", False, "state")
    except Refused:
        return None
    return numbers if numbers.size <= MOST_OF_STATE else None


def kind_of(environment, metrics):
    import gymnasium

    if isinstance(environment, gymnasium.Env):
        return Single(environment, metrics)
    if all(hasattr(environment, name) for name in ("possible_agents", "action_space", "reset", "step")):
        if hasattr(environment, "agent_iter"):
            raise Refused(
                "make",
                "agents take turns in this environment (AEC): make it by its `parallel_env`, or convert it by "
                "pettingzoo.utils.aec_to_parallel",
            )
        return Parallel(environment, metrics)
    raise Refused(
        "make",
        f"what it makes is of type {type(environment).__name__}, which is neither a gymnasium.Env nor an environment of "
        "PettingZoo's parallel interface",
    )
