//! Plays: the players of each role, the environment, and the training trials that come first.

use super::{
    cells::Cells,
    checked_sections::{MOST_TRIALS, Sections},
    config::{self, Files, locate},
    part::Form,
    path::KeyPath,
    sections::PlayText,
    written::{NamedPart, Target},
};
use contract::{Environment, part::Part, protocol};
use document::{
    Node,
    diagnostic::{Diagnostic, Span, suggest},
    schema_check::{At, Checker},
};
use presentation::vocabulary::{Pairs, Play, Player};

/// The plays of a study.
///
/// # Errors
/// Unknown names, seats without exactly one role, and agents that cannot meet.
pub(super) fn resolve(
    sections: &Sections<'_>,
    cells: &Cells,
    n_seeds: usize,
) -> Result<Vec<Play>, Vec<Diagnostic>> {
    let (mut plays, mut found) = (Vec::new(), Vec::new());
    for named in &sections.written.plays {
        // The check of the study ends at a play that the schema refuses.
        let Some(text) = sections.text.cross_play.get(&named.name) else {
            continue;
        };
        let mut reader = CrossPlayReader {
            text,
            sections,
            cells,
            named,
            at: format!("cross_play.{}", named.name),
            found: Vec::new(),
        };
        let play = reader.play(n_seeds);
        match play.filter(|_| reader.found.is_empty()) {
            Some(play) => plays.push(play),
            None => found.extend(reader.found),
        }
    }
    if found.is_empty() { Ok(plays) } else { Err(found) }
}

struct CrossPlayReader<'a> {
    text: &'a PlayText,
    sections: &'a Sections<'a>,
    cells: &'a Cells,
    named: &'a NamedPart,
    at: String,
    found: Vec<Diagnostic>,
}

impl CrossPlayReader<'_> {
    fn play(&mut self, n_seeds: usize) -> Option<Play> {
        let environment = self.environment()?;
        let players = self.players(environment);
        let first = players.first()?.cell;
        self.trained_alike(&players);
        let over = self.named.config.get("environment_config").cloned();
        let over = over.unwrap_or_else(|| Node::empty_mapping(self.named.name_span));
        let (arena, built) = self.arena(first, &over)?;
        let seats: Vec<String> = built.seats().iter().map(|seat| seat.name.clone()).collect();
        let roles = self.roles(&seats);
        let (pairs, episodes) = (self.text.pairs, self.text.episodes);
        let per_combination = match pairs {
            Pairs::Matched => Some(n_seeds as u64),
            Pairs::All => (n_seeds as u64).checked_pow(u32::try_from(roles.len()).unwrap_or(u32::MAX)),
        };
        self.too_many(players.len(), roles.len(), per_combination);
        let Some(measuring) = self.sections.registry.measuring else {
            self.say(
                self.named.name_span,
                "",
                "no protocol of this program measures policies that learn no more",
                "register one that does, as `train_evaluate`",
            );
            return None;
        };
        let metrics = protocol::measurement_metrics()
            .into_iter()
            .chain(built.metrics().iter().cloned())
            .map(|metric| metric.name)
            .collect();
        let (name, environment) = (
            self.named.name.clone(),
            self.sections.written.environments[environment].name.clone(),
        );
        Some(Play {
            name,
            environment,
            roles,
            players,
            metrics,
            arena,
            episodes,
            pairs,
            protocol: measuring(episodes),
            environment_config: self.text.environment_config.clone(),
        })
    }

    fn say(&mut self, span: Span, key: &str, message: impl Into<String>, help: impl Into<String>) {
        let at = if key.is_empty() {
            self.at.clone()
        } else {
            format!("{}.{key}", self.at)
        };
        let (error, help) = (self.sections.sources.error(span, &at, message), help.into());
        self.found
            .push(if help.is_empty() { error } else { error.help(help) });
    }

    fn environment(&mut self) -> Option<usize> {
        let name = self.text.environment.as_str();
        let known: Vec<&str> = self
            .sections
            .written
            .environments
            .iter()
            .map(|it| it.name.as_str())
            .collect();
        let index = known.iter().position(|it| *it == name);
        if index.is_none() {
            let span = self.named.config.get("environment")?.span;
            self.say(
                span,
                "environment",
                format!("no environment is named `{name}`"),
                suggest(name, known),
            );
        }
        index
    }

    /// The listed agents, or all agents that learn in this environment.
    fn players(&mut self, environment: usize) -> Vec<Player> {
        let agents = &self.sections.written.agents;
        let learns = |index: usize| self.sections.learns(Target::Agent(index));
        let listed = self.named.config.entry("agents");
        let span = listed.map_or(self.named.name_span, |entry| entry.key_span);
        let here = |index: &usize| !self.cells.of_pair((environment, *index)).is_empty();
        let all = || {
            (0..agents.len())
                .filter(|index| learns(*index) && here(index))
                .map(|index| (index, span))
                .collect()
        };
        let chosen: Vec<(usize, Span)> = listed.map_or_else(all, |entry| self.listed(entry.value.items()));
        let mut players: Vec<Player> = Vec::new();
        for (index, span) in chosen {
            if let Some(cell) = self.only_cell(environment, index, span) {
                let name = self.sections.written.agents[index].name.clone();
                players.push(Player {
                    name,
                    learns: self.cells.at(cell).parts[2].given.form != Form::Alone,
                    cell,
                });
            }
        }
        if players.len() < 2 && self.found.is_empty() {
            let message = format!(
                "`{}` needs at least two agents that meet, and has {}",
                self.named.name,
                players.len()
            );
            self.say(
                span,
                "agents",
                message,
                "without `agents`, all agents play that learn in this environment",
            );
        }
        players
    }

    fn listed(&mut self, items: &[Node]) -> Vec<(usize, Span)> {
        let mut indices: Vec<(usize, Span)> = Vec::new();
        for (name, item) in self.text.agents.iter().zip(items) {
            let known: Vec<&str> = self
                .sections
                .written
                .agents
                .iter()
                .map(|it| it.name.as_str())
                .collect();
            match known.iter().position(|it| it == name) {
                None => self.say(
                    item.span,
                    "agents",
                    format!("no agent is named `{name}`"),
                    suggest(name, known),
                ),
                Some(index) if indices.iter().any(|(other, _)| *other == index) => {
                    self.say(
                        item.span,
                        "agents",
                        format!("`{name}` is listed twice"),
                        "remove one of the two",
                    );
                }
                Some(index) => indices.push((index, item.span)),
            }
        }
        indices
    }

    /// The only cell that trains an agent in this environment.
    fn only_cell(&mut self, environment: usize, agent: usize, span: Span) -> Option<usize> {
        let found = self.cells.of_pair((environment, agent));
        let name = &self.sections.written.agents[agent].name;
        match found.len() {
            1 => return Some(found.start),
            0 => {
                let message = format!("no trial feeds the agent `{name}` here");
                self.say(
                    span,
                    "agents",
                    message,
                    "`exclude` leaves out its combination with this environment",
                );
            }
            several => {
                let message =
                    format!("`{name}` has {several} settings here, and each would be another player");
                self.say(
                    span,
                    "agents",
                    message,
                    "give each setting a name of its own under `agents` instead of a sweep",
                );
            }
        }
        None
    }

    /// Refuses agents that were trained in different environments.
    fn trained_alike(&mut self, players: &[Player]) {
        let Some((first, others)) = players.split_first() else {
            return;
        };
        let environment = |player: &Player| self.cells.at(player.cell).parts[0].id().to_owned();
        if let Some(other) = others
            .iter()
            .find(|other| environment(other) != environment(first))
        {
            let message = format!(
                "`{}` and `{}` are trained in different variants of the environment",
                first.name, other.name
            );
            self.say(
                self.named.name_span,
                "",
                message,
                "an override sets its keys for one of them",
            );
        }
    }

    /// The environment of a cell with the keys of `environment_config` written over it.
    fn arena(&mut self, cell: usize, over: &Node) -> Option<(Part, Box<dyn Environment>)> {
        let [trained, ..] = self.cells.at(cell).parts;
        let given = &trained.given;
        let plugin = self.sections.plugin(given.target)?;
        let mut checker = Checker::new(self.sections.sources);
        checker.check(
            over,
            &At {
                key: over.span,
                name: "environment_config".into(),
                path: format!("{}.environment_config", self.at),
            },
            &plugin.schema,
        );
        if !checker.found.is_empty() {
            self.found.extend(checker.found);
            return None;
        }
        let mut config = self.sections.assigned(given);
        for entry in over.entries() {
            let (config_schema, keys) = (plugin.schema.clone(), vec![entry.key.clone()]);
            let schema = config_schema.property(&entry.key)?;
            let path = KeyPath {
                target: given.target,
                keys,
                config: config_schema,
                schema,
                span: entry.key_span,
            };
            path.assign(&mut config, &entry.value);
        }
        let mut files = Files::new(self.sections.folder);
        let resolved = config::resolve(&plugin, &config, &mut files, self.sections.sources);
        let part = resolved.map_err(|errors| self.found.extend(errors)).ok()?;
        let build = &self.sections.registry.environments[part.plugin.as_str()].build;
        match (build(&part.config), build(&trained.part.config)) {
            (Ok(arena), Ok(trained)) if arena.interface() == trained.interface() => {
                return Some((part, arena));
            }
            (Ok(_), _) => {
                let message = "this changes what the seats see or do, so that no agent fits them any more";
                self.say(
                    self.span_of("environment_config"),
                    "environment_config",
                    message,
                    "",
                );
            }
            (Err(error), _) => {
                let key = if let contract::Error::Config { key, .. } = &error {
                    key.as_str()
                } else {
                    ""
                };
                let span = locate(over, key).unwrap_or_else(|| self.span_of("environment_config"));
                self.say(span, "environment_config", error.to_string(), "");
            }
        }
        None
    }

    fn span_of(&self, key: &str) -> Span {
        self.named
            .config
            .entry(key)
            .map_or(self.named.name_span, |entry| entry.key_span)
    }

    /// Checks that every seat has one role; returns the roles with their seats.
    fn roles(&mut self, seats: &[String]) -> Vec<(String, Vec<String>)> {
        let named = self.named;
        let written = named.config.get("roles").map_or(&[][..], Node::entries);
        let mut taken: Vec<(&str, &str)> = Vec::new();
        let text = self.text;
        for role in written {
            let own = text.roles.get(&role.key).into_iter().flat_map(|own| &own.0);
            for (seat, item) in own.zip(role.value.items()) {
                if self.is_free((seat, item.span), &role.key, seats, &taken) {
                    taken.push((seat, &role.key));
                }
            }
        }
        let own = |role: &str| {
            let own = seats.iter().filter(|seat| taken.contains(&(seat.as_str(), role)));
            own.cloned().collect()
        };
        let mut roles: Vec<(String, Vec<String>)> = written
            .iter()
            .map(|role| (role.key.clone(), own(&role.key)))
            .collect();
        let is_left = |seat: &&String| !taken.iter().any(|(known, _)| known == seat);
        self.nobody_is_left(&seats.iter().filter(is_left).collect::<Vec<_>>());
        if roles.len() < 2 && self.found.is_empty() {
            let help = "agents that play all seats together are what their own trials measure";
            let message = "agents meet only where there are at least two roles";
            self.say(self.span_of("roles"), "roles", message, help);
        }
        roles.sort();
        roles
    }

    /// Whether a seat exists and has no role yet.
    fn is_free(
        &mut self,
        (seat, span): (&str, Span),
        role: &str,
        seats: &[String],
        taken: &[(&str, &str)],
    ) -> bool {
        let at = format!("roles.{role}");
        if !seats.iter().any(|known| known == seat) {
            let help = suggest(seat, seats.iter().map(String::as_str));
            let message = format!("the environment has no seat `{seat}`");
            self.say(span, &at, message, help);
            return false;
        }
        let other = taken.iter().find(|(known, _)| *known == seat);
        if let Some((_, other)) = other {
            let message = format!("`{seat}` has a role already: `{other}`");
            self.say(span, &at, message, "every seat has one role");
        }
        other.is_none()
    }

    fn nobody_is_left(&mut self, left: &[&String]) {
        if left.is_empty() || !self.found.is_empty() {
            return;
        }
        let left: Vec<String> = left.iter().map(|seat| format!("`{seat}`")).collect();
        self.say(
            self.span_of("roles"),
            "roles",
            format!("no role for {}", left.join(", ")),
            "every seat of the environment has one role",
        );
    }

    fn too_many(&mut self, players: usize, roles: usize, per_combination: Option<u64>) {
        let combinations = u32::try_from(roles)
            .ok()
            .and_then(|roles| (players as u64).checked_pow(roles));
        if combinations
            .zip(per_combination)
            .and_then(|(count, each)| count.checked_mul(each))
            .is_none_or(|trials| trials > MOST_TRIALS)
        {
            let message =
                format!("{players} agents in {roles} roles make too many trials: at most {MOST_TRIALS}");
            self.say(
                self.named.name_span,
                "",
                message,
                "list fewer `agents`, or put seats into the same role",
            );
        }
    }
}
