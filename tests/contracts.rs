//! Contract of every registered plugin: these tests loop over the registry.

use contract::{
    Action, Agent, Channel, Environment, Error, Feed, Interface, NoKeeper, Phase, Registry, Rng, Space,
    random::stream, registry::AgentEntry, standard_metrics::UPDATES, trial::TrialKey,
};
use plugins::registry;
use rand::Rng as _;

/// The environments that are there with their defaults: one in Python and one of a program have to be named.
pub(crate) fn ready_made(registry: &Registry) -> impl Iterator<Item = &'static str> {
    registry
        .environments
        .keys()
        .copied()
        .filter(|name| !["named", "python"].contains(name))
}

/// The agents that a protocol trains or measures with their defaults: a program, which trains itself, and one in Python
/// have to be named.
pub(crate) fn acting(registry: &Registry) -> impl Iterator<Item = (&'static str, &AgentEntry)> {
    let all = registry.agents.iter().map(|(name, entry)| (*name, entry));
    all.filter(|(_, entry)| !entry.traits.trains_itself && entry.traits.by_config.is_none())
}

#[test]
fn a_program_and_its_task_have_to_be_named() {
    let registry = registry();
    let entry = &registry.environments["named"];
    let refusal = (entry.build)(&entry.about.defaults).err().unwrap().to_string();
    assert!(refusal.contains("`id`: names no task"), "{refusal}");
    let entry = &registry.agents["program"];
    let interface = default_environment(&registry, "allocation_bandit").interface();
    let refusal = (entry.build)(&entry.about.defaults, &interface, &mut stream(&["contract"]));
    let refusal = refusal.err().unwrap().to_string();
    assert!(refusal.contains("`run`: names no program"), "{refusal}");
}

#[test]
fn no_agent_acts_where_there_is_nothing_to_act_in() {
    let registry = registry();
    let nothing = Interface {
        seats: Vec::new(),
        state: Vec::new(),
    };
    for (name, entry) in acting(&registry) {
        match (entry.build)(&entry.about.defaults, &nothing, &mut stream(&["contract"])) {
            Err(Error::Mismatch { problem, .. }) => {
                assert!(problem.contains("named alone"), "{name}: {problem}");
            }
            _ => panic!("{name} acts in an environment that is named alone"),
        }
    }
}

#[test]
fn what_is_written_in_python_has_to_be_named() {
    let registry = registry();
    let entry = &registry.environments["python"];
    let refusal = (entry.build)(&entry.about.defaults).err().unwrap().to_string();
    assert!(refusal.contains("`make`: `` names nothing"), "{refusal}");
    let entry = &registry.agents["python"];
    let interface = default_environment(&registry, "allocation_bandit").interface();
    let refusal = (entry.build)(&entry.about.defaults, &interface, &mut stream(&["contract"]));
    let refusal = refusal.err().unwrap().to_string();
    assert!(
        refusal.contains("`make`: `` names nothing that makes an agent"),
        "{refusal}"
    );
    assert!(!entry.learns_with(&entry.about.defaults));
}

fn default_environment(registry: &Registry, name: &str) -> Box<dyn Environment> {
    let entry = &registry.environments[name];
    (entry.build)(&entry.about.defaults).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Any action of each seat's space.
fn random_action(environment: &dyn Environment, rng: &mut Rng) -> Action {
    let draw = |space: &Space, rng: &mut Rng| match space {
        Space::Box(channels) => channels
            .iter()
            .map(|channel| rng.random_range(channel.low.max(-1.0)..=channel.high.min(1.0)))
            .collect(),
        Space::Simplex(names) => {
            let draws: Vec<f64> = names
                .iter()
                .map(|_| -rng.random::<f64>().max(1e-300).ln())
                .collect();
            let sum: f64 = draws.iter().sum();
            draws.into_iter().map(|draw| draw / sum).collect()
        }
        Space::Discrete(names) => vec![f64::from(
            rng.random_range(0..u32::try_from(names.len()).unwrap()),
        )],
        Space::Choices(_) => (0..space.len()).map(|_| rng.random_range(-1.0..=1.0)).collect(),
    };
    environment
        .seats()
        .iter()
        .map(|seat| draw(&seat.action, rng))
        .collect()
}

#[test]
fn every_preset_is_a_config() {
    let registry = registry();
    let abouts = registry
        .environments
        .values()
        .map(|entry| &entry.about)
        .chain(registry.agents.values().map(|entry| &entry.about));
    for about in abouts {
        for preset in &about.presets {
            (about.resolve)(&preset.values).unwrap_or_else(|error| panic!("{}: {error}", preset.name));
        }
    }
}

/// The agent with its defaults, where it fits the environment: any other reason to refuse it is a mistake.
fn fitting(registry: &Registry, name: &str, interface: &Interface, rng: &mut Rng) -> Option<Box<dyn Agent>> {
    let entry = &registry.agents[name];
    match (entry.build)(&entry.about.defaults, interface, rng) {
        Ok(agent) => Some(agent),
        Err(Error::Mismatch { .. }) => None,
        Err(error) => panic!("{name}: {error}"),
    }
}

/// Steps after which an episode that has not ended is left.
const LONGEST: u32 = 20_000;

#[test]
fn what_environments_give_out_is_what_they_say_through_whole_episodes() {
    let registry = registry();
    for name in ready_made(&registry) {
        let mut environment = default_environment(&registry, name);
        let mut rng = stream(&["contract", name]);
        for episode in 0..2 {
            let seats = environment.reset(&mut rng).unwrap();
            assert_within_ranges(
                &*environment,
                &seats,
                &format!("{name}, start of episode {episode}"),
            );
            let mut steps = 0;
            loop {
                steps += 1;
                let place = format!("{name}, step {steps} of episode {episode}");
                let action = random_action(&*environment, &mut rng);
                let step = environment
                    .step(&action, &mut rng)
                    .unwrap_or_else(|error| panic!("{place}: {error}"));
                assert_within_ranges(&*environment, &step.observations, &place);
                assert_eq!(step.rewards.len(), seats.len(), "{place}: one reward per seat");
                let recorded: Vec<&str> = step.metrics.iter().map(|(name, _)| &**name).collect();
                let metrics = environment.metrics().iter();
                let declared: Vec<&str> = metrics.map(|metric| &*metric.name).collect();
                assert_eq!(recorded, declared, "{place}: a value per metric");
                assert!(
                    step.rewards
                        .iter()
                        .chain(step.metrics.iter().map(|(_, value)| value))
                        .all(|value| value.is_finite()),
                    "{place}: {step:?}"
                );
                if step.end.is_some() {
                    break;
                }
                assert!(steps < LONGEST, "{place}: the episode does not end");
            }
        }
    }
}

/// Observations of the seats and the full state lie within the ranges of their channels; of a trace, what has a value
/// yet.
fn assert_within_ranges(environment: &dyn Environment, observations: &[Vec<f64>], place: &str) {
    assert_eq!(
        observations.len(),
        environment.seats().len(),
        "{place}: one observation per seat"
    );
    for (seat, values) in environment.seats().iter().zip(observations) {
        assert_eq!(values.len(), seat.observation.len(), "{place}: {values:?}");
        if let Space::Box(channels) = &seat.observation {
            let wrong = outside(channels, values);
            assert!(wrong.is_empty(), "{place}: seat `{}` sees {wrong:?}", seat.name);
        }
    }
    let (channels, values) = (environment.state_channels(), environment.state());
    assert_eq!(values.len(), channels.len(), "{place}: state");
    let wrong = outside(&channels, &values);
    assert!(wrong.is_empty(), "{place}: the state has {wrong:?}");
    let (channels, values) = (environment.trace_channels(), environment.trace());
    assert_eq!(values.len(), channels.len(), "{place}: trace");
    let there: Vec<(Channel, f64)> = channels
        .into_iter()
        .zip(values)
        .filter(|(_, value)| !value.is_nan())
        .collect();
    let (channels, values): (Vec<Channel>, Vec<f64>) = there.into_iter().unzip();
    let wrong = outside(&channels, &values);
    assert!(wrong.is_empty(), "{place}: the trace has {wrong:?}");
}

/// Values that are not finite or lie beyond the limits of their channels.
fn outside(channels: &[Channel], values: &[f64]) -> Vec<String> {
    let is_in =
        |channel: &Channel, value: f64| value.is_finite() && (channel.low..=channel.high).contains(&value);
    let pairs = channels
        .iter()
        .zip(values)
        .filter(|(channel, value)| !is_in(channel, **value));
    pairs
        .map(|(channel, value)| {
            format!(
                "{} = {value}, not in {}..{}",
                channel.name, channel.low, channel.high
            )
        })
        .collect()
}

#[test]
fn channels_have_names_of_their_own_and_a_spread() {
    let registry = registry();
    for name in ready_made(&registry) {
        let environment = default_environment(&registry, name);
        let mut names: Vec<String> = environment
            .trace_channels()
            .into_iter()
            .map(|channel| channel.name)
            .collect();
        names.sort();
        let count = names.len();
        names.dedup();
        assert_eq!(names.len(), count, "{name}: two trace channels of one name");
        for seat in environment.seats() {
            if let Space::Box(channels) = &seat.observation {
                assert!(
                    channels
                        .iter()
                        .all(|channel| channel.spread > 0.0 && channel.low <= channel.high),
                    "{name}: {channels:?}"
                );
            }
        }
    }
}

#[test]
fn a_restored_environment_continues_to_the_same_bits() {
    let registry = registry();
    for name in ready_made(&registry) {
        let (mut first, mut second) = (
            default_environment(&registry, name),
            default_environment(&registry, name),
        );
        let mut rng = stream(&["contract", name]);
        first.reset(&mut rng).unwrap();
        let text = first.snapshot().to_string();
        second.reset(&mut stream(&["another start"])).unwrap();
        second.restore(&serde_json::from_str(&text).unwrap()).unwrap();
        let mut other = rng.clone();
        let action = random_action(&*first, &mut stream(&["action"]));
        let (one, two) = (
            first.step(&action, &mut rng).unwrap(),
            second.step(&action, &mut other).unwrap(),
        );
        assert_eq!(one, two, "{name}");
    }
}

#[test]
fn agents_act_within_the_space_of_an_environment_that_takes_them() {
    let registry = registry();
    for (name, _) in acting(&registry) {
        let mut taken = 0;
        for environment_name in ready_made(&registry) {
            let mut environment = default_environment(&registry, environment_name);
            let mut rng = stream(&["contract", name]);
            let Some(mut agent) = fitting(&registry, name, &environment.interface(), &mut rng) else {
                continue;
            };
            taken += 1;
            let seats = environment.reset(&mut rng).unwrap();
            let state = if agent.reads_state() {
                environment.state()
            } else {
                Vec::new()
            };
            let observation = contract::Observation { seats, state };
            for mode in [contract::Mode::Train, contract::Mode::Evaluate] {
                let rows = vec![observation.clone(); if agent.remembers() { 1 } else { 2 }];
                let actions = agent.act(&rows, mode, &mut rng).unwrap();
                assert_eq!(actions.len(), rows.len(), "{name}: one action per row");
                let mut copy = default_environment(&registry, environment_name);
                copy.reset(&mut stream(&["contract", name])).unwrap();
                copy.step(&actions[0], &mut rng)
                    .unwrap_or_else(|error| panic!("{name} in {environment_name}: {error}"));
            }
        }
        assert!(taken > 0, "no environment takes {name}");
    }
}

#[test]
fn agents_that_learn_count_their_updates_and_others_have_none_to_count() {
    let registry = registry();
    for (name, entry) in acting(&registry) {
        for environment in ready_made(&registry) {
            let interface = default_environment(&registry, environment).interface();
            let Some(agent) = fitting(&registry, name, &interface, &mut stream(&["contract"])) else {
                continue;
            };
            let updates = agent.updates();
            assert_eq!(updates.is_some(), entry.traits.learns(), "{name}");
            assert!(
                updates.is_none_or(|updates| updates.made == 0 && updates.first_after > 0),
                "{name}: {updates:?}"
            );
        }
        if entry.traits.learns() {
            assert!(
                learns_as_told(&registry, name),
                "no small trial in which {name} makes an update"
            );
        }
    }
}

/// True where some small trial of an agent ends with updates; none of them may come before the step that the
/// agent tells.
fn learns_as_told(registry: &Registry, name: &str) -> bool {
    let taken = &registry.agents[name].traits.learns_from[..];
    let fits = |key: &TrialKey| match key.protocol.plugin.as_str() {
        "supervised_fit" => Feed::Examples.teaches(taken),
        "offline_fit" => Feed::Dataset.teaches(taken),
        "attribution" => false,
        "search" => Feed::Designs.teaches(taken),
        _ => Feed::Decisions.teaches(taken),
    };
    crate::resume::keys(registry, name)
        .into_iter()
        .filter(fits)
        .any(|key| {
            let record = match crate::datasets::run(registry, &key, None, &mut NoKeeper) {
                Ok(record) => record,
                // An agent that does not fit the environment, or an environment that gives no datasets.
                Err(Error::Mismatch { .. } | Error::ManySeats { .. } | Error::MixedSeats { .. }) => {
                    return false;
                }
                Err(error) => panic!("{name} in {}: {error}", key.environment.plugin),
            };
            let environment =
                (registry.environments[key.environment.plugin.as_str()].build)(&key.environment.config)
                    .unwrap();
            let agent = &registry.agents[name];
            let agent = (agent.build)(
                &key.agent.agent().unwrap().config,
                &environment.interface(),
                &mut stream(&["contract"]),
            )
            .unwrap();
            let first_after = agent.updates().unwrap().first_after;
            let updates = record
                .rows()
                .iter()
                .filter(|row| record.names()[usize::from(row.metric)] == UPDATES);
            // A step of these is a batch.
            let in_batches = ["supervised_fit", "offline_fit"].contains(&key.protocol.plugin.as_str());
            let early = |step: u64| !in_batches && step < first_after;
            updates
                .clone()
                .for_each(|row| assert!(row.value == 0.0 || !early(row.step), "{name}: {row:?}"));
            updates
                .filter(|row| row.phase == Phase::Final)
                .map(|row| row.value)
                .sum::<f64>()
                > 0.0
        })
}

/// Estimators of gradients have closed forms, and two searches have counts, in place of networks.
#[test]
fn the_plan_of_every_agent_that_trains_networks_can_be_printed() {
    let registry = registry();
    let interfaces: Vec<Interface> = ready_made(&registry)
        .map(|name| default_environment(&registry, name).interface())
        .collect();
    let (mut printed, mut without) = (0, Vec::new());
    for (name, entry) in acting(&registry).filter(|(_, entry)| entry.traits.learns()) {
        let build = |interface| (entry.build)(&entry.about.defaults, interface, &mut stream(&["plan"])).ok();
        let mut agent = interfaces
            .iter()
            .find_map(build)
            .unwrap_or_else(|| panic!("{name} fits nowhere"));
        match (agent.plan(8), agent.updates()) {
            (Some(plan), _) => {
                assert!(
                    plan.contains(" operations, ") && plan.contains("<- Adam"),
                    "{name}: {plan}"
                );
                // Convolutions alone have no kernel.
                let has_kernels = !plan.contains("no kernel for a card");
                assert!(has_kernels || name == "image_classifier", "{name}: {plan}");
                printed += 1;
            }
            (None, Some(_)) => without.push(name),
            (None, None) => {}
        }
    }
    let no_networks = [
        "dirichlet_gradient",
        "gaussian_softmax_gradient",
        "opponent_gradients",
        "regularised_evolution",
        "tree_parzen",
    ];
    assert_eq!(without, no_networks);
    assert!(printed >= 20, "{printed}");
}
