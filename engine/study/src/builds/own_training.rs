//! Agents that train themselves: their commands, their forms of measurement and the metrics that they record.

use super::{BuildResult, Builder, FROM_THE_FIRST_STEP};
use crate::{cell::Cell, part::Form};
use contract::{
    Agent, Error, Metric,
    own_training::{Assignment, MEASURED, Measured},
};
use document::diagnostic::Diagnostic;
use presentation::vocabulary::Vocabulary;

impl Builder<'_> {
    /// Checks an agent that trains itself against its environment, and notes the metrics that it records.
    pub(super) fn note_own_training(
        &mut self,
        cell: &Cell,
        built: &mut dyn Agent,
        vocabulary: &mut Vocabulary,
    ) -> BuildResult<()> {
        let agent = &cell.parts[1];
        let entry = &self.sections.registry.environments[cell.parts[0].part.plugin.as_str()];
        let begun = self.config(cell, 0).and_then(|config| {
            let assignment = Assignment {
                environment: entry.named(&config),
                ..Assignment::default()
            };
            built
                .own_training()
                .map_or(Ok(Vec::new()), |training| training.command(&assignment))
        });
        begun.map_err(|error| self.refused_in_environment(cell, &error))?;
        if self.warned.insert((agent.given.target, FROM_THE_FIRST_STEP, 0)) {
            let seeds = vocabulary.seeds.len();
            let doubts = built
                .own_training()
                .map_or(Vec::new(), |training| training.doubts(seeds));
            let doubts = doubts.iter().map(|doubt| self.refused(agent, doubt).as_warning());
            vocabulary.warnings.extend(doubts);
        }
        let measured = built.own_training().and_then(|training| training.measured());
        let recorded = built.records();
        let refused = self.measured_otherwise(cell, measured);
        if let Some(error) = refused.or_else(|| self.is_taken(cell, &recorded)) {
            return Err(Box::new(self.refused(agent, &error)));
        }
        let Some(pair) = cell.pair() else { return Ok(()) };
        self.note(cell, pair, || recorded, vocabulary)
    }

    /// A refusal of the words of an agent, whose values may lack in one of several environments.
    fn refused_in_environment(&self, cell: &Cell, error: &Error) -> Box<Diagnostic> {
        let refused = self.refused(&cell.parts[1], error);
        let environments = &self.sections.written.environments;
        let named = cell
            .pair()
            .and_then(|(environment, _)| environments.get(environment));
        Box::new(match named.filter(|_| environments.len() > 1) {
            Some(named) => refused.note(
                "with this environment",
                self.sections.sources.place(named.name_span),
            ),
            None => refused,
        })
    }

    /// The error of an agent that trains itself and asks for a form of measurement that its protocol does not have.
    fn measured_otherwise(&self, cell: &Cell, measured: Option<Measured>) -> Option<Error> {
        let facts = self.facts(cell)?;
        let seats = facts.interface.seats.len();
        let problem = if cell.parts[2].given.form != Form::Own(measured) {
            "it is said in the agent itself: no sweep, search or override can change it".to_owned()
        } else if measured.is_some() && seats == 0 {
            "nothing can be measured in an environment that is only named: leave it out, so that the program says its \
             own numbers"
                .to_owned()
        } else if measured.is_some() && seats != 1 {
            format!("a program is measured where one agent acts, and this environment has seats for {seats}")
        } else {
            return None;
        };
        Some(Error::config(MEASURED, problem))
    }

    /// The error of a metric whose name means something else for the agents that the protocol trains. In an environment
    /// with seats, both may appear in one table.
    fn is_taken(&self, cell: &Cell, recorded: &[Metric]) -> Option<Error> {
        let facts = self.facts(cell)?;
        let measures = self.protocols.get(cell.parts[2].id())?.as_ref()?;
        let mut known = measures.metrics.iter().chain(&facts.metrics);
        let taken = known.find(|known| recorded.iter().any(|it| it.name == known.name))?;
        let problem = format!(
            "`{}` is measured of the other agents of this environment, and another thing than a program says of \
             itself: take another name, as `own_{}`",
            taken.name, taken.name
        );
        (!facts.interface.seats.is_empty()).then(|| Error::config("metrics", problem))
    }
}
