//! Numbers and versions: one tiny trial of every plugin is pinned to the bit, so that no change of code moves
//! a number under an old version.
//!
//! A pin holds the whole trial (plugins with complete configs), so that it does not move with defaults, and
//! runs with version 0 of everything, so that it does not move with a version. It has one digest: the bits are the same
//! on every processor.
//!
//! `REGIMEN_PINS=write cargo test --release --workspace pins` writes new pins and those of raised versions.

mod recorded;

use crate::{
    contracts::{acting, ready_made},
    datasets::with_sources,
    needs::{self, programs},
    program::repository,
    shrunk::shrunk,
};
use contract::{Registry, part::Part, plugin::About};
use plugins::registry;
use recorded::{digest, recorded};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{collections::BTreeMap, fs, path::PathBuf, process::Command};

/// How to write pins.
const COMMAND: &str = "REGIMEN_PINS=write cargo test --release --workspace pins";

/// Variable with the pins that are compared, by name with commas between them; all where it is absent.
const SOME: &str = "REGIMEN_SOME_PINS";

/// One pinned trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Pin {
    /// Environment, agent and protocol with the versions under which the digests hold.
    trial: [Part; 3],
    /// Version of the shared numerics under which they hold.
    numerics: u32,
    /// Digest of everything that the trial records.
    digest: String,
}

/// Pins by `kind plugin`, as in `agent ddpg`.
type Pins = BTreeMap<String, Pin>;

#[test]
fn no_number_moves_under_an_old_version() {
    let registry = registry();
    let pins = read();
    let writes = std::env::var("REGIMEN_PINS").as_deref() == Ok("write");
    let some = std::env::var(SOME).ok();
    let complaints: Vec<String> = subjects(&registry)
        .into_iter()
        .filter(|subject| {
            some.as_ref()
                .is_none_or(|some| some.split(',').any(|name| name == subject))
        })
        .filter_map(|subject| match pins.get(&subject) {
            Some(pin) => check(&registry, &subject, pin),
            None => Some(format!("{subject} has no pin yet. To add one: {COMMAND}")),
        })
        .collect();
    if writes {
        write(&registry, pins);
    } else {
        assert!(complaints.is_empty(), "\n\n{}\n", complaints.join("\n\n"));
    }
}

/// Three agents and three environments.
const ON_OTHER_PROCESSORS: [&str; 6] = [
    "agent soft_actor_critic",
    "agent dirichlet_sac",
    "agent tdom_ac",
    "environment battery",
    "environment turbofan",
    "environment component_replacement",
];

/// An emulated processor of 2008 has SSE alone, and no fused multiply-adds.
#[test]
fn a_processor_without_wide_vectors_has_the_same_numbers() {
    let Some([emulator]) = programs(["qemu-x86_64"]) else {
        return;
    };
    let program = std::env::current_exe().unwrap();
    let mut command = Command::new(emulator);
    command.args(["-cpu", "Nehalem"]).arg(program);
    command
        .args(["--exact", "pins::no_number_moves_under_an_old_version"])
        .env(SOME, ON_OTHER_PROCESSORS.join(","));
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
}

/// The digests of pins and of the arithmetic, computed by an emulated aarch64 and the distribution's compiler.
#[test]
fn a_processor_of_another_kind_has_the_same_numbers() {
    let (Some([emulator]), Some(program)) = (programs(["qemu-aarch64"]), needs::run_pins()) else {
        return;
    };
    let mut command = Command::new(emulator);
    command.args(["-L", "/usr/aarch64-linux-gnu"]).arg(program);
    let output = command.arg(file()).args(ON_OTHER_PROCESSORS).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let found: BTreeMap<&str, &str> = text.lines().filter_map(|line| line.rsplit_once(' ')).collect();
    let pins = read();
    let kept = fs::read_to_string(repository().join("plugins/arithmetic/fixtures/digests.txt")).unwrap();
    let mut expected: BTreeMap<&str, &str> = BTreeMap::new();
    expected.extend(ON_OTHER_PROCESSORS.map(|name| (name, pins[name].digest.as_str())));
    expected.extend(kept.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        // The second digest is of the first class; steps have no classes.
        (words[0], *words.get(2).unwrap_or(&words[1]))
    }));
    assert_eq!(found, expected);
}

#[test]
fn every_pin_is_of_a_registered_plugin() {
    let subjects = subjects(&registry());
    let stale: Vec<String> = read()
        .into_keys()
        .filter(|name| !subjects.contains(name))
        .collect();
    assert!(
        stale.is_empty(),
        "{stale:?} are not registered; to drop their pins: {COMMAND}"
    );
}

#[test]
fn a_moved_number_and_a_raised_version_are_told_apart() {
    let registry = registry();
    let [name, other] = ["environment allocation_bandit", "environment battery"];
    let pins = [name, other].map(|name| read().remove(name).unwrap());
    let mut pin = pins[0].clone();
    assert_eq!(check(&registry, name, &pin), None);
    pin.digest.clone_from(&pins[1].digest);
    let moved = check(&registry, name, &pin).unwrap();
    assert!(
        moved.contains("no version was raised") && moved.contains("plugins/environments/src/lib.rs"),
        "{moved}"
    );
    assert!(
        moved.contains("plugins/numerics/src/lib.rs") && moved.contains(COMMAND),
        "{moved}"
    );
    pin.trial[0].version += 1;
    let raised = check(&registry, name, &pin).unwrap();
    assert!(
        raised.contains("allocation_bandit 2 -> 1") && raised.contains(COMMAND),
        "{raised}"
    );
}

/// Difference from a pin; `None` where it holds.
fn check(registry: &Registry, subject: &str, pin: &Pin) -> Option<String> {
    let raised = raised(registry, pin);
    if !raised.is_empty() {
        return Some(format!(
            "{subject}: the pin is of other versions ({}). To renew it: {COMMAND}",
            raised.join(", ")
        ));
    }
    match digest(registry, &pin.trial) {
        Err(problem) => Some(format!(
            "{subject}: the pinned trial cannot run any more: {problem}\n{}",
            advice(pin)
        )),
        Ok(found) if found != pin.digest => Some(format!(
            "{subject}: the numbers of the pinned trial moved, and no version was raised: stored trials \
             would stand beside new \
             ones of other code.\n{}",
            advice(pin)
        )),
        Ok(_) => None,
    }
}

/// Which constants to raise, in which files.
fn advice(pin: &Pin) -> String {
    let [environment, agent, protocol] = pin.trial.each_ref().map(|part| (&part.plugin, part.version));
    format!(
        "Raise the version of what you changed:\n\
         - environment `{}` (now {}): the number after its name in plugins/environments/src/lib.rs\n\
         - agent `{}` (now {}): the number after its name in the plugins/*/src/lib.rs that registers it\n\
         - protocol `{}` (now {}): the number after its name in plugins/protocols/src/{4}.rs\n\
         - shared code (now {} together): `VERSION` in plugins/numerics/src/lib.rs, or `NUMERICS_VERSION` in \
         engine/contract/src/registry.rs\n\
         Then renew the pins: {COMMAND}",
        environment.0, environment.1, agent.0, agent.1, protocol.0, protocol.1, pin.numerics
    )
}

/// Versions that are not those of a pin, as in `ddpg 1 -> 2`.
fn raised(registry: &Registry, pin: &Pin) -> Vec<String> {
    let kinds = ["environment", "agent", "protocol"];
    let parts = kinds.iter().zip(&pin.trial).map(|(kind, part)| {
        let now =
            about(registry, kind, &part.plugin).map_or("none".into(), |about| about.version.to_string());
        (part.plugin.clone(), part.version.to_string(), now)
    });
    let numerics = (
        "numerics".to_owned(),
        pin.numerics.to_string(),
        registry.numerics_version.to_string(),
    );
    parts
        .chain([numerics])
        .filter(|(_, then, now)| then != now)
        .map(|(name, then, now)| format!("{name} {then} -> {now}"))
        .collect()
}

fn about<'a>(registry: &'a Registry, kind: &str, name: &str) -> Option<&'a About> {
    match kind {
        "environment" => registry.environments.get(name).map(|entry| &entry.about),
        "agent" => registry.agents.get(name).map(|entry| &entry.about),
        _ => registry.protocols.get(name).map(|entry| &entry.about),
    }
}

/// Everything that must have a pin.
fn subjects(registry: &Registry) -> Vec<String> {
    // An environment in Python is pinned by its lock file, and a program by its sources.
    let environments = ready_made(registry).map(|name| format!("environment {name}"));
    let agents = acting(registry).map(|(name, _)| format!("agent {name}"));
    let protocols = registry.protocols.keys().map(|name| format!("protocol {name}"));
    environments.chain(agents).chain(protocols).collect()
}

fn file() -> PathBuf {
    repository().join("tests/fixtures/pins/pins.json")
}

fn read() -> Pins {
    fs::read_to_string(file()).map_or_else(|_| Pins::new(), |text| serde_json::from_str(&text).unwrap())
}

/// Writes pins that are missing or of other versions; one that moved under its version is left as it is.
fn write(registry: &Registry, old: Pins) {
    let mut pins = Pins::new();
    for subject in subjects(registry) {
        let pin = match old.get(&subject) {
            Some(pin) if raised(registry, pin).is_empty() => pin.clone(),
            Some(pin) => renew(registry, pin).unwrap_or_else(|| new(registry, &subject)),
            None => new(registry, &subject),
        };
        pins.insert(subject, pin);
    }
    fs::create_dir_all(file().parent().unwrap()).unwrap();
    fs::write(file(), serde_json::to_string_pretty(&pins).unwrap() + "\n").unwrap();
}

/// The pinned trial with the versions and the numbers of today; `None` where it cannot run any more.
fn renew(registry: &Registry, pin: &Pin) -> Option<Pin> {
    let [environment, agent, protocol] = &pin.trial;
    let today = |kind: &str, part: &Part| {
        let about = about(registry, kind, &part.plugin)?;
        Some(with_sources(Part::new(
            part.plugin.clone(),
            about.version,
            (about.resolve)(&part.config).ok()?,
        )))
    };
    pinned(
        registry,
        [
            today("environment", environment)?,
            today("agent", agent)?,
            today("protocol", protocol)?,
        ],
    )
}

fn pinned(registry: &Registry, trial: [Part; 3]) -> Option<Pin> {
    let digest = digest(registry, &trial).ok()?;
    Some(Pin {
        trial,
        numerics: registry.numerics_version,
        digest,
    })
}

/// The tiny trial of a plugin that records most, so that it goes through as much code as can be; where an
/// agent is pinned that learns, it must have learned.
fn new(registry: &Registry, subject: &str) -> Pin {
    let (kind, name) = subject.split_once(' ').unwrap();
    let candidates = |of: &str, names: Vec<&'static str>| -> Vec<Part> {
        let wanted = names
            .into_iter()
            .filter(|candidate| of != kind || *candidate == name);
        wanted
            .map(|name| small(about(registry, of, name).unwrap(), name))
            .collect()
    };
    let learns = |agent: &Part| registry.agents[agent.plugin.as_str()].traits.learns();
    let mut agents = candidates("agent", acting(registry).map(|(name, _)| name).collect());
    if kind == "environment" && agents.iter().any(|agent| !learns(agent)) {
        // Pins of environments do not move with an algorithm.
        agents.retain(|agent| !learns(agent));
    }
    let mut best: Option<(usize, [Part; 3])> = None;
    for environment in candidates("environment", registry.environments.keys().copied().collect()) {
        for agent in &agents {
            for protocol in candidates("protocol", registry.protocols.keys().copied().collect()) {
                let trial = [environment.clone(), agent.clone(), protocol];
                let rows = recorded(registry, &trial)
                    .ok()
                    .filter(|rows| kind != "agent" || learned(registry, agent, rows));
                let count = rows.map_or(0, |rows| rows.lines().count());
                if count > best.as_ref().map_or(0, |(most, _)| *most) {
                    best = Some((count, trial));
                }
            }
        }
    }
    let (_, trial) =
        best.unwrap_or_else(|| panic!("no tiny trial of {subject} runs: see `tiny` in tests/pins.rs"));
    pinned(registry, trial).unwrap()
}

/// True where an agent recorded what it records when it learns, or has nothing to record.
fn learned(registry: &Registry, agent: &Part, rows: &str) -> bool {
    let metrics = &registry.agents[agent.plugin.as_str()].traits.metrics;
    let says = |metric: &contract::Metric| {
        rows.lines()
            .any(|line| line.split(' ').nth(4) == Some(metric.name.as_str()))
    };
    metrics.is_empty() || metrics.iter().any(says)
}

/// Values that make a trial small, for whichever plugin has a parameter of that name.
fn tiny() -> Value {
    json!({
        "steps": 48, "environments": 4, "evaluate_every": 24, "episodes": 1, "final_episodes": 2,
        "trace_episodes": 1, "decisions": 4,
        "batch": 8, "batches": 4, "examples": 4, "final_examples": 4,
        "width": 16, "batch_size": 8, "learning_starts": 16, "updates_per_step": 0.5, "replay_capacity": 64,
        "episode_limit": 5, "datasets": [{ "from": "given" }],
        "evaluations": 20, "exploration_steps": 12, "growth_at": [6, 15], "derived_designs": 2, "kept_designs": 1, "population": 2,
        "n_startup": 2, "images": { "shapes": { "count": 20 } }, "size": 8, "critic_steps": 2,
        "generator_batch": 4, "generator_channels": 4, "discriminator_channels": 4, "latent": 4,
        "scored_images": 10, "reference_images": 20, "splits": 1,
    })
}

fn small(about: &About, name: &str) -> Part {
    with_sources(Part::new(name, about.version, shrunk(about, &tiny())))
}
