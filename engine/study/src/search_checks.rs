//! Checks of searches against the metrics of trials: the compared metric and the pauses.

use super::{checked_sections::Sections, parts, search::LocatedSearch, written::Target};
use analysis::search::Search;
use contract::{
    Better, Interface, random,
    standard_metrics::{TIME_PER_DECISION, TIME_PER_UPDATE, WALL_TIME},
};
use document::diagnostic::Diagnostic;
use presentation::{
    names::{Names, Picked, Place},
    vocabulary::Vocabulary,
};

/// Checks the metrics by which searches compare settings.
pub fn searches(sections: &Sections<'_>, vocabulary: &Vocabulary) -> Vec<Diagnostic> {
    let mut names = Names::new(vocabulary, sections.sources);
    for (written, searched) in sections.written.searches.iter().zip(sections.searches) {
        let place = Place {
            node: &written.config,
            key: written.name_span,
            at: format!("tune.{}", written.name),
        };
        let picked = Picked {
            agents: vec![searched.agent],
            environments: vec![searched.environment],
        };
        if names.recorded(&picked).is_empty() {
            let Search {
                agent, environment, ..
            } = &searched.search;
            let message =
                format!("`{agent}` has no trials in `{environment}`, so no setting can be compared there");
            names.say(
                place.value("environment"),
                message,
                "`exclude` leaves the combination out",
            );
        }
        names.metric(&searched.search.metric, &place, "metric", &picked);
        compared_by(&mut names, &searched.search, &place);
        pauses(&mut names, sections, searched, &place);
    }
    names.into_found()
}

/// Reports a metric that cannot compare settings, or a missing direction of a metric whose lower values are better.
fn compared_by(names: &mut Names<'_>, search: &Search, place: &Place<'_>) {
    let metric = &search.metric;
    if [WALL_TIME, TIME_PER_UPDATE, TIME_PER_DECISION].contains(&metric.as_str()) {
        let message = format!(
            "`{metric}` is a measurement of the machine, by which every run would choose another setting"
        );
        names.say(
            place.value("metric"),
            message,
            "compare settings by what their trials record",
        );
    }
    let known = names
        .vocabulary
        .metrics
        .iter()
        .find(|known| known.name == *metric);
    let is_loss = known.is_some_and(|metric| metric.better == Better::Lower);
    if is_loss && place.node.get("direction").is_none() {
        let message = format!(
            "of `{metric}` less is better, and without a `direction` the setting with the most of it is chosen"
        );
        names.say(
            place.value("metric"),
            message,
            "write `direction: minimize`, or `direction: maximize` where that is meant",
        );
    }
}

/// Reports a search that cannot pause its trials, and a population that cannot continue from the pauses.
fn pauses(names: &mut Names<'_>, sections: &Sections<'_>, searched: &LocatedSearch<'_>, place: &Place<'_>) {
    let plugin = sections.written.protocol.plugin.as_str();
    let config = parts::protocol_of(sections, searched);
    let entry = sections.registry.protocols.get(plugin);
    let built = entry
        .zip(config)
        .and_then(|(entry, config)| (entry.build)(&config).ok());
    let Some(protocol) = built else { return };
    let (search, schema) = (&searched.search, sections.plugin(Target::Protocol));
    let (kind, pauses) = if search.is_population() {
        ("population", search.generation_ends())
    } else {
        ("halving", search.pauses())
    };
    let can_go_on = schema.is_some_and(|plugin| plugin.schema.property("go_on_from").is_some());
    let cannot_go_on = !can_go_on && search.is_population();
    let falls = pauses.windows(2).any(|pair| pair[0] >= pair[1]);
    let steps = protocol.total_steps();
    let beyond = pauses
        .iter()
        .find(|pause| search.is_population() && **pause >= steps);
    let unmeasured = pauses
        .iter()
        .find(|pause| !search.is_population() && !protocol.measures_at(**pause));
    let (message, help) = if search.is_population() && own_training(sections, searched).is_some() {
        let message = "an agent that trains itself cannot go on from what another one has learned".to_owned();
        (message, "use another method")
    } else if !pauses.is_empty() && own_training(sections, searched) == Some(false) {
        let message = "the agent would begin anew after every pause".to_owned();
        (
            message,
            "say how it goes on, as `resume` does of a program, or use another method",
        )
    } else if cannot_go_on {
        let message = format!("in `{plugin}` learning cannot go on from another trial's");
        (message, "use the protocol `train_evaluate`, or another method")
    } else if let Some(pause) = unmeasured {
        let message = format!("`{plugin}` measures nothing at step {pause}, where trials pause");
        (message, "write multiples of `evaluate_every` below the last step")
    } else if falls {
        (
            "pauses do not rise".to_owned(),
            "write them in the order of steps",
        )
    } else if let Some(pause) = beyond {
        let message = format!("learning ends at step {steps}, so that nothing goes on at step {pause}");
        (message, "write steps below the last one")
    } else {
        return;
    };
    let place = place
        .below("method")
        .and_then(|place| place.below(kind))
        .unwrap_or_else(|| place.clone());
    names.say(place.value("pauses"), message, help);
}

/// Whether an agent that trains itself continues after a pause; `None` for other agents.
fn own_training(sections: &Sections<'_>, searched: &LocatedSearch<'_>) -> Option<bool> {
    let named = sections.written.part(Target::Agent(searched.agent))?;
    let entry = sections.registry.agents.get(named.plugin.as_str());
    let entry = entry.filter(|entry| entry.traits.trains_itself)?;
    let config = parts::agent_of(sections, searched)?;
    let nothing = Interface {
        seats: Vec::new(),
        state: Vec::new(),
    };
    let mut agent = (entry.build)(&config, &nothing, &mut random::stream(&["check"])).ok()?;
    agent.own_training().map(|training| training.goes_on())
}
