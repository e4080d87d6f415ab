//! Every policy that an agent leaves acts as the agent.

use super::*;

/// Files that a small trial of an agent left, and the way the agent acts.
struct Trained {
    folder: tempfile::TempDir,
    environment: Box<dyn Environment>,
    agent: Box<dyn Agent>,
}

/// A small trial of an agent, where it fits environment and protocol and leaves a policy.
fn trained(registry: &Registry, key: &TrialKey) -> Option<Trained> {
    let folder = tempfile::tempdir().unwrap();
    // Some agents say by a panic that they do not fit.
    let run = AssertUnwindSafe(|| datasets::run(registry, key, Some(folder.path()), &mut NoKeeper));
    catch_unwind(run).ok()?.ok()?;
    if !ArtifactKind::Policy.lies_in(folder.path()) {
        return None;
    }
    let environment = &registry.environments[key.environment.plugin.as_str()];
    let environment = (environment.build)(&key.environment.config).unwrap();
    let interface = environment.interface();
    let find = |_: &Taken| Ok(folder.path().to_path_buf());
    let agent = trained_agent(key, registry, &interface, &Streams::new("a", "b", 0), &find).unwrap();
    Some(Trained {
        folder,
        environment,
        agent,
    })
}

/// The policies in a folder, as `export` finds them.
fn portable(registry: &Registry, folder: &Path) -> Vec<PortablePolicy> {
    let read = |folder: &Path| {
        let mut forms = registry.policy_forms.values();
        forms.find_map(|form| (form.read)(folder).unwrap())
    };
    if folder.join("policy.safetensors").exists() {
        return read(folder).unwrap_or_default();
    }
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.join("policy.safetensors").exists() {
            let seat = path.file_name().unwrap().to_string_lossy().into_owned();
            all.extend(read(&path).unwrap().into_iter().map(|policy| {
                let seat = seat.clone();
                PortablePolicy { seat, ..policy }
            }));
        }
    }
    all
}

/// Observations of all seats while the agent acts, rounded to single precision.
fn observations(environment: &mut dyn Environment, agent: &mut dyn Agent) -> Vec<Observation> {
    let mut rng = stream(&["portable", "observations"]);
    let mut rows: Vec<Observation> = Vec::new();
    let mut seats = environment.reset(&mut rng).unwrap();
    while rows.len() < ROWS {
        let round = |row: &Vec<f64>| row.iter().copied().map(single).collect();
        let seen = Observation {
            seats: seats.iter().map(round).collect(),
            state: environment.state(),
        };
        let action = agent
            .act(std::slice::from_ref(&seen), Mode::Train, &mut rng)
            .unwrap()
            .remove(0);
        rows.push(seen);
        let step = environment.step(&action, &mut rng).unwrap();
        seats = match step.end {
            None => step.observations,
            Some(_) => environment.reset(&mut rng).unwrap(),
        };
    }
    rows
}

/// Holds what one trial left: each policy against the action of its seat, where the agent acts by the policy alone.
fn hold_trial(registry: &Registry, name: &str, trained: &mut Trained, cases: &Cases) -> usize {
    let rows = observations(&mut *trained.environment, &mut *trained.agent);
    let actions = trained
        .agent
        .act(&rows, Mode::Evaluate, &mut stream(&["portable"]))
        .unwrap();
    let policies = portable(registry, trained.folder.path());
    for policy in &policies {
        let seats = trained.environment.seats();
        let at = seats
            .iter()
            .position(|seat| seat.name == policy.seat)
            .unwrap_or(0);
        let seen = |row: &Observation| match policy.inputs.len() {
            n if n == row.seats[at].len() => row.seats[at].clone(),
            _ => row.seats.concat(),
        };
        let seen: Vec<Vec<f64>> = rows.iter().map(seen).collect();
        let onnx = (policy.to_onnx)(&[]);
        let name = format!("{name}-{}", policy.seat);
        if seen[0].len() == policy.inputs.len() {
            let action = |row: &[f64]| {
                let row = seen.iter().position(|it| it == row).unwrap();
                actions[row][at].clone()
            };
            cases.add(&name, &onnx, &seen, action);
        } else {
            // A sampler reads noise beside the observation, and its agent chooses among its draws.
            let file = Policy::read(&trained.folder.path().join(&policy.seat)).unwrap();
            let rows = around(
                &file.header.center,
                &file.header.spread,
                &mut stream(&["portable", "noise"]),
            );
            cases.add(&name, &onnx, &rows, |row| file.act(row));
        }
    }
    policies.len()
}

/// The same trial with a final measurement of one episode, which no policy depends on.
fn with_few_episodes(registry: &Registry, mut key: TrialKey) -> TrialKey {
    let mut part = (*key.protocol).clone();
    let mut config = (*part.config).clone();
    for name in ["final_episodes", "final_examples", "trace_episodes"] {
        if config.get(name).is_some() {
            config[name] = json!(1);
        }
    }
    let resolve = &registry.protocols[part.plugin.as_str()].about.resolve;
    if let Ok(config) = resolve(&config) {
        part.config = config;
        key.protocol = part.into();
    }
    key
}

#[test]
fn every_policy_that_an_agent_leaves_is_taken_away_and_acts_as_the_agent() {
    let (registry, cases) = (registry(), Cases::new());
    let mut held: BTreeMap<&str, usize> = BTreeMap::new();
    let mut refused = BTreeSet::new();
    for (name, entry) in crate::contracts::acting(&registry) {
        for key in crate::resume::keys(&registry, name)
            .into_iter()
            .filter(|_| entry.traits.learns())
        {
            let is_untrained = ["attribution", "track"].contains(&key.protocol.plugin.as_str());
            if key.environment.plugin == "generator_search" || is_untrained {
                continue;
            }
            let key = with_few_episodes(&registry, key);
            let Some(mut trained) = trained(&registry, &key) else {
                continue;
            };
            let case = format!("{name}-{}-{}", key.environment.plugin, key.protocol.plugin);
            match hold_trial(&registry, &case, &mut trained, &cases) {
                0 => drop(refused.insert(name)),
                n => *held.entry(name).or_default() += n,
            }
        }
    }
    // It tells images apart: nothing acts by it.
    assert_eq!(refused, BTreeSet::from(["image_classifier"]));
    assert!(held.values().all(|n| *n > 0));
    let learners = crate::contracts::acting(&registry).filter(|(_, entry)| entry.traits.learns());
    let without: BTreeSet<&str> = learners
        .map(|(name, _)| name)
        .filter(|name| !held.contains_key(name))
        .collect();
    // Estimators of gradients and searches have no policy.
    let expected = [
        "autogan",
        "dirichlet_gradient",
        "gaussian_softmax_gradient",
        "image_classifier",
        "regularised_evolution",
        "tree_parzen",
    ];
    assert_eq!(without, BTreeSet::from(expected));
    cases.hold();
}

/// Settings that give an agent another network, another sight or another scaling.
#[test]
fn networks_of_every_setting_act_as_the_agent() {
    let (registry, cases) = (registry(), Cases::new());
    let settings = [
        ("dirichlet_sac", "battery", json!({ "network": "equivariant" })),
        (
            "dirichlet_sac",
            "battery",
            json!({ "network": "equivariant", "evaluation_action": "mode" }),
        ),
        ("dirichlet_sac", "battery", json!({ "evaluation_action": "mode" })),
        (
            "dirichlet_sac",
            "battery",
            json!({ "observation_scaling": "none" }),
        ),
        ("maddpg", "particles", json!({ "policy_sight": "joint" })),
        ("independent_sac", "particles", json!({ "sight": "joint" })),
        ("masql", "particles", json!({ "sight": "joint" })),
        (
            "tdom_ac",
            "particles",
            json!({ "sight": "own", "input_normalisation": false }),
        ),
        (
            "tdom_ac",
            "particles",
            json!({ "sight": "own", "input_normalisation": true }),
        ),
        (
            "rommeo",
            "particles",
            json!({ "sight": "joint", "input_normalisation": true }),
        ),
        (
            "pr2",
            "particles",
            json!({ "sight": "own", "input_normalisation": true }),
        ),
        (
            "pr2",
            "particles",
            json!({ "sight": "joint", "input_normalisation": false }),
        ),
    ];
    for (at, (agent, environment, changes)) in settings.into_iter().enumerate() {
        let mut key = crate::resume::keys(&registry, agent)
            .into_iter()
            .find(|key| key.environment.plugin == environment && key.protocol.plugin == "train_evaluate")
            .unwrap();
        let mut part = key.agent.agent().unwrap().clone();
        let mut config = (*part.config).clone();
        for (name, value) in changes.as_object().unwrap() {
            config[name] = value.clone();
        }
        part.config = (registry.agents[agent].about.resolve)(&config).unwrap();
        key.agent = contract::cast::Actors::Agent(part).into();
        let mut trained = trained(&registry, &key).unwrap_or_else(|| panic!("{agent} {changes}"));
        assert!(hold_trial(&registry, &format!("{agent}-{at}"), &mut trained, &cases) > 0);
    }
    cases.hold();
}
