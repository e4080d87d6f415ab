//! Claims against the names that trials record.

use crate::{
    claim_spec::{ClaimSpec, ClaimText},
    names::{Names, Picked},
};
use analysis::claim::{self, Aggregate, Claim, ClaimError, Operand, Quantity, Within};
use contract::{standard_metrics::SUCCESS, sweep_point::as_word};
use document::{
    Node,
    diagnostic::{Span, suggest},
};

/// A text of the study, such as a claim, with its position.
pub(super) struct Text<'a> {
    pub(super) text: &'a str,
    pub(super) span: Span,
    pub(super) at: &'a str,
}

impl Text<'_> {
    /// The position of `length` bytes from byte `start`.
    pub(super) fn place(&self, start: usize, length: usize) -> (Span, String) {
        let characters =
            |from: usize, to: usize| self.text.get(from..to).map_or(0, |part| part.chars().count());
        // The text may begin with a quotation mark, which is part of the span but not of the claim.
        let quote = usize::from(self.span.length > self.text.chars().count());
        let column = self.span.column + quote + characters(0, start);
        (
            Span {
                column,
                length: characters(start, start + length),
                ..self.span
            },
            self.at.into(),
        )
    }

    /// The position of a word of an operand, `skip` characters behind its start.
    fn part_of(&self, operand: &Operand, skip: usize, word: &str) -> (Span, String) {
        let (whole, at) = self.word(&operand.path());
        let span = Span {
            column: whole.column + skip,
            length: word.chars().count(),
            ..whole
        };
        (span, at)
    }

    /// The position of a word that the parser found in the text.
    fn word(&self, word: &str) -> (Span, String) {
        self.place(self.text.find(word).unwrap_or(0), word.len())
    }
}

impl Names<'_> {
    /// Checks every name in a claim.
    pub(super) fn claim(&mut self, claim: &ClaimText, item: &Node, at: &str) -> Option<ClaimSpec> {
        let (spec, node) = match claim {
            ClaimText::Alone(text) => (
                ClaimSpec {
                    claim: text.clone(),
                    ..ClaimSpec::default()
                },
                item,
            ),
            ClaimText::Long(spec) => (spec.clone(), item.get("claim")?),
        };
        let outer = match item.get("environment") {
            Some(node) => Some(self.known(
                node,
                "environment",
                &self.vocabulary.environments,
                &format!("{at}.environment"),
            )?),
            None => None,
        };
        let text = Text {
            text: &spec.claim,
            span: node.span,
            at,
        };
        match claim::parse(&spec.claim) {
            Err(ClaimError { position, message }) => {
                let rest = &spec.claim[position..];
                let length = rest.find(char::is_whitespace).unwrap_or(rest.len());
                self.say(
                    text.place(position, length),
                    message,
                    "a claim reads `AGENT.METRIC > AGENT.METRIC`, with numbers where needed",
                );
            }
            Ok(claim) => {
                let environment = self.claimed_environment(&claim, outer, &text);
                let plays = |operand: &&Operand| operand.within.is_some();
                let in_place = |operand: &Operand| operand.environment.is_some();
                let of_plays = claim.operands().iter().all(plays) && environment.is_some();
                if of_plays || claim.operands().into_iter().filter(plays).any(in_place) {
                    let message = "a play has an environment of its own, so a claim about it names none";
                    self.say(
                        text.place(0, text.text.len()),
                        message,
                        "leave the environment out",
                    );
                }
                self.operands(&claim, environment, &text);
                self.shares(&claim, &text);
                self.min_effect(&claim, item, &text);
            }
        }
        Some(spec)
    }

    /// Checks that `min_effect` belongs to a claim with a direction; `within` has a distance of its own.
    fn min_effect(&mut self, claim: &Claim, item: &Node, text: &Text<'_>) {
        if let Some(entry) = item
            .entry("min_effect")
            .filter(|_| !claim.relation.is_direction())
        {
            self.say(
                (entry.key_span, format!("{}.min_effect", text.at)),
                "`min_effect` is for claims that one side is ahead; this one says itself how far both may be apart",
                "remove the key, or write the claim with `>`, `>=`, `<` or `<=`",
            );
        }
    }

    /// The environment that a claim names in its text or beside it.
    fn claimed_environment(&mut self, claim: &Claim, outer: Option<usize>, text: &Text<'_>) -> Option<usize> {
        if outer.is_some() && claim.environments_of_sides().is_some() {
            self.say(
                text.place(0, text.text.len()),
                "each side of the claim names its environment, and so does the key `environment`",
                "remove the key",
            );
        }
        let Some(name) = &claim.environment else {
            return outer;
        };
        let (index, place) = self.environment_named(name, text);
        if index.is_none() {
            return outer;
        }
        if outer.is_some() && outer != index {
            self.say(
                place,
                "the claim names another environment than the key `environment`",
                "remove one of the two",
            );
        }
        index.or(outer)
    }

    /// The environment that the text names after `in`, with its position; reports an unknown name.
    fn environment_named(&mut self, name: &str, text: &Text<'_>) -> (Option<usize>, (Span, String)) {
        let named = format!("in {name}");
        let ends = |at: &usize| !text.text[at + named.len()..].starts_with(claim::is_name_character);
        let mut places = text.text.rmatch_indices(&named).map(|(at, _)| at);
        let behind = places.find(ends).map(|at| at + "in ".len());
        let start = behind.or_else(|| text.text.rfind(name)).unwrap_or(0);
        let place = text.place(start, name.len());
        let index = self
            .vocabulary
            .environments
            .iter()
            .position(|known| known == name);
        if index.is_none() {
            let help = suggest(name, self.vocabulary.environments.iter().map(String::as_str));
            self.say(place.clone(), format!("no environment is named `{name}`"), help);
        }
        (index, place)
    }

    /// Checks `PLAY.ROLE.AGENT.METRIC`.
    fn in_play(&mut self, operand: &Operand, within: &Within, text: &Text<'_>) {
        let (vocabulary, Within { play: name, role }) = (self.vocabulary, within);
        let start = text.text.find(&operand.path()).unwrap_or(0);
        let place = |before: &[&str], word: &str| {
            let skip: usize = before.iter().map(|name| name.len() + 1).sum();
            text.place(start + skip, word.len())
        };
        let Some(play) = vocabulary.plays.iter().find(|play| play.name == *name) else {
            let help = suggest(name, vocabulary.plays.iter().map(|play| play.name.as_str()));
            return self.say(place(&[], name), format!("no play is named `{name}`"), help);
        };
        if !play.roles.iter().any(|(known, _)| known == role) {
            let help = suggest(role, play.roles.iter().map(|(known, _)| known.as_str()));
            self.say(
                place(&[name], role),
                format!("`{name}` has no role `{role}`"),
                help,
            );
        }
        if !play.players.iter().any(|player| player.name == operand.agent) {
            let help = suggest(
                &operand.agent,
                play.players.iter().map(|player| player.name.as_str()),
            );
            let message = format!("no agent of `{name}` is named `{}`", operand.agent);
            self.say(place(&[name, role], &operand.agent), message, help);
        }
        let metric = place(&[name, role, &operand.agent], &operand.metric);
        if !play.metrics.contains(&operand.metric) {
            self.unknown_metric(&operand.metric, metric, &play.metrics);
        } else if operand.aggregate != Aggregate::Final {
            let message = format!("a play has no learning curve for `{}`", operand.aggregate.name());
            self.say(metric, message, "write the metric alone");
        }
    }

    /// Checks claims on success: a share is compared with a number or another share, without a factor.
    fn shares(&mut self, claim: &Claim, text: &Text<'_>) {
        let sides = [&claim.left, &claim.right];
        let share = |side: &&Quantity| {
            matches!(side, Quantity::Measured { operand,
            .. } if operand.metric == SUCCESS)
        };
        for side in sides.into_iter().filter(share) {
            let Quantity::Measured { factor, operand } = side else {
                continue;
            };
            let place = text.word(&operand.path());
            match operand.aggregate {
                _ if *factor != 1.0 => {
                    let message = "a share of successes takes no factor";
                    self.say(
                        place,
                        message,
                        "claim an order, or a distance with `within NUMBER of`",
                    );
                }
                Aggregate::Final => {}
                Aggregate::GivenSuccess => {
                    self.say(
                        place,
                        "the share of successes among successes is 1",
                        "write the metric alone",
                    );
                }
                aggregate => {
                    let message = format!(
                        "`success` is judged by the final measurement, so it has no `{}`",
                        aggregate.name()
                    );
                    self.say(place, message, "write the metric alone");
                }
            }
        }
        let other = |side: &&&Quantity| matches!(side, Quantity::Measured { .. }) && !share(side);
        if let (true, Some(Quantity::Measured { operand, .. })) =
            (sides.iter().any(share), sides.iter().find(other))
        {
            let message = format!(
                "`{}` is no share, so successes cannot be compared with it",
                operand.metric
            );
            self.say(
                text.word(&operand.path()),
                message,
                "compare them with a number or with `AGENT.success`",
            );
        }
    }

    /// The first key or value of an operand's setting that no sweep has, with a message and advice.
    fn unknown_setting(&self, operand: &Operand) -> Option<(String, String, String)> {
        let vocabulary = self.vocabulary;
        operand.setting.iter().find_map(|(key, value)| {
            if let Some(message) = vocabulary.ambiguity(key) {
                return Some((key.clone(), message, String::new()));
            }
            let agent = vocabulary.agents.iter().position(|name| *name == operand.agent);
            let values = vocabulary.swept_values(key, agent);
            if values.is_empty() {
                let help = suggest(key, vocabulary.swept_names());
                return Some((key.clone(), format!("no sweep varies `{key}`"), help));
            }
            let message = || format!("the sweep gives `{key}` no value `{value}`");
            let help = || suggest(value, values.iter().map(String::as_str));
            (!values.contains(&as_word(value))).then(|| (value.clone(), message(), help()))
        })
    }

    fn operands(&mut self, claim: &Claim, environment: Option<usize>, text: &Text<'_>) {
        for operand in claim.operands() {
            if let Some(within) = &operand.within {
                self.in_play(operand, within, text);
            } else if let Some(environments) = self.environments_of(operand, environment, text) {
                self.in_trials(operand, environments, text);
            }
        }
    }

    /// The environments in which an operand is evaluated: its own, that of the claim, or all.
    fn environments_of(
        &mut self,
        operand: &Operand,
        of_claim: Option<usize>,
        text: &Text<'_>,
    ) -> Option<Vec<usize>> {
        match (&operand.environment, of_claim) {
            (Some(name), _) => Some(vec![self.environment_named(name, text).0?]),
            (None, Some(index)) => Some(vec![index]),
            (None, None) => Some((0..self.vocabulary.environments.len()).collect()),
        }
    }

    /// Checks `AGENT.METRIC` against the metrics of the agent's trials.
    fn in_trials(&mut self, operand: &Operand, environments: Vec<usize>, text: &Text<'_>) {
        let name = &operand.agent;
        let at_agent = text.part_of(operand, 0, name);
        let Some(agent) = self.vocabulary.agents.iter().position(|known| known == name) else {
            let help = suggest(name, self.vocabulary.agents.iter().map(String::as_str));
            return self.say(at_agent, format!("no agent is named `{name}`"), help);
        };
        if let Some((word, message, help)) = self.unknown_setting(operand) {
            return self.say(text.word(&word), message, help);
        }
        let recorded = self.recorded(&Picked {
            agents: vec![agent],
            environments,
        });
        if recorded.is_empty() {
            let help = "`exclude` leaves out its combinations with these environments";
            self.say(at_agent, format!("no trial feeds the agent `{name}` here"), help);
        } else if operand.aggregate == Aggregate::GivenSuccess && !recorded.contains(SUCCESS) {
            let message = "the study does not say what a success is";
            let help = "write a section `success: { metric: METRIC, above: VALUE }`";
            self.say(at_agent, message, help);
        } else if !recorded.contains(&operand.metric) {
            let skip = operand.path().chars().count() - operand.metric.chars().count();
            let place = text.part_of(operand, skip, &operand.metric);
            self.unknown_metric(&operand.metric, place, &recorded);
        }
    }
}
