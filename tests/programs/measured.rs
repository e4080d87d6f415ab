//! Programs that the engine measures, beside agents of its own on the same episodes.

use super::*;
use crate::needs;
use contract::{artifact::no_artifact, part::Part, random::Streams, recorder::Phase};
use numerics::onnx::Graph;
use std::collections::BTreeMap;

/// A study of a program beside an agent that does nothing, in an environment with a simulator.
fn study(program: &str) -> String {
    format!(
        "study: both\nenvironments: {{ swing: {{ pendulum: {{}} }} }}\nagents:\n  still: {{ zero_action: {{}} }}\n  mine:\n    \
         program:\n{program}\n      lock: none\nprotocol: {{ train_evaluate: {{ steps: 100, evaluate_every: 50, episodes: 3, \
         final_episodes: 300 }} }}\nseeds: 2\nclaims:\n  - {{ claim: mine.return > still.return, why: they do the same }}\n\
         tables: {{ returns: {{ comparison: {{ rows: agent, value: return }} }} }}\n"
    )
}

/// Every value that was measured of agents of a plugin, or of taken policies without one, to the bit: by seed,
/// phase, step, episode and metric.
fn measured(bench: &Bench, plugin: &str, phases: &[Phase]) -> BTreeMap<(u64, Phase, u64, u64, String), u64> {
    let mut found = BTreeMap::new();
    for file in trial_files(&bench.path("store")) {
        let trial: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
        if trial["key"]["agent"]["plugin"].as_str().unwrap_or_default() != plugin {
            continue;
        }
        let seed = trial["key"]["seed"].as_u64().unwrap();
        let table = contract::metrics_file::read(&file.with_file_name("metrics.parquet")).unwrap();
        for row in table.rows.iter().filter(|row| phases.contains(&row.phase)) {
            let name = table.names[usize::from(row.metric)].clone();
            found.insert(
                (seed, row.phase, row.step, row.episode, name),
                row.value.to_bits(),
            );
        }
    }
    found
}

/// The same, without what the program says itself.
fn of_engine(bench: &Bench, own: &[&str], phases: &[Phase]) -> BTreeMap<(u64, Phase, u64, u64, String), u64> {
    let mut found = measured(bench, "program", phases);
    found.retain(|(.., name), _| !own.contains(&name.as_str()) && name != "own_steps");
    found
}

/// Runs the study, whose trials have to end well.
fn ended_well(bench: &Bench) {
    let answer = ended(bench);
    let said = format!("{}\n{}\n{}", answer.out, answer.err, reason(bench));
    assert!([0, 102].contains(&answer.code), "{said}");
}

fn ended(bench: &Bench) -> Answer {
    bench.run(&["run", "study.yaml", "-j", "2", "--yes"])
}

/// Why the first trial that failed did so.
fn reason(bench: &Bench) -> String {
    let ends = trial_files(&bench.path("store")).into_iter().map(|file| {
        let trial: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        trial["end"]["reason"].as_str().unwrap_or_default().to_owned()
    });
    ends.into_iter()
        .find(|reason| !reason.is_empty())
        .unwrap_or_default()
}

fn in_python(program: &str, more: &str) -> Option<Bench> {
    let python = needs::python("json")?;
    let bench = Bench::new();
    bench.write("a.py", program);
    let program = format!(
        "      run: [python3, a.py]\n      interpreter: {python}\n      sources: [a.py]\n      measured: calls\n{more}"
    );
    bench.write("study.yaml", &study(&program));
    Some(bench)
}

#[test]
fn a_program_that_acts_by_a_constant_has_the_bits_of_a_constant_agent() {
    let program = "import regimen_trial as regimen\ntrial = regimen.trial()\nact = lambda rows: [0.0] * len(rows)\n\
        for step in range(0, 101, 25):\n    means = trial.measure(act, step=step)\n    \
        assert (means is None) == (step % 50 > 0), means\n    \
        if means: trial.log(step=step, seen=means['return'])\ntrial.measure(act)\n";
    let more = "      reads: { from: log }\n      metrics: { own_return: seen }";
    let Some(bench) = in_python(program, more) else {
        return;
    };
    ended_well(&bench);
    let phases = [Phase::Evaluate, Phase::Final];
    let still = measured(&bench, "zero_action", &phases);
    assert!(still.len() > 2 * 300 * 4, "{}", still.len());
    assert!(of_engine(&bench, &["own_return"], &phases) == still);
    let said = measured(&bench, "program", &[Phase::Train]);
    assert_eq!(said.len(), 2 * 3, "what it says itself stands beside: {said:?}");
}

#[test]
fn a_number_that_a_program_reports_is_not_paired_with_a_measurement() {
    let bench = Bench::new();
    bench.write("a.sh", "echo step=100 r=$1\n");
    let program =
        "      run: [sh, a.sh, \"{seed}\"]\n      sources: [a.sh]\n      metrics: { own_return: r }";
    let claim = "claim: mine.own_return > still.return";
    let study = study(program).replace("claim: mine.return > still.return", claim);
    bench.write(
        "study.yaml",
        &study
            .replace("seeds: 2", "seeds: 3")
            .replace("value: return", "value: own_return"),
    );
    ended_well(&bench);
    let report = || fs::read_to_string(bench.path("results/both/report.md")).unwrap();
    let first = report();
    assert!(
        first.contains("n = 3 seeds") && !first.contains("3 pairs"),
        "{first}"
    );
    fs::remove_dir_all(bench.path("store")).unwrap();
    bench.ok(&["report", "study.yaml", "--recorded"]);
    assert!(report().contains("n = 3 seeds"), "{}", report());
}

/// Observations of the first two training environments of agents of the engine, when they begin and after a step.
fn observed(seed: u64) -> Vec<f64> {
    let registry = plugins::registry();
    let entry = &registry.environments["pendulum"];
    let config = entry.about.defaults.clone();
    let part = Part::new("pendulum", entry.about.version, config);
    let streams = Streams::new("", &part.stream_id(&entry.about), seed);
    let of_slot = |slot| {
        let mut environment = (entry.build)(&part.loaded(&no_artifact).unwrap()).unwrap();
        let mut rng = streams.environment("train", slot);
        let began = environment.reset(&mut rng).unwrap().concat();
        let step = environment.step(&[vec![0.5]], &mut rng).unwrap();
        [began, step.observations.concat()]
    };
    let [one, two] = [0, 1].map(of_slot);
    [one[0].clone(), one[1].clone(), two[0].clone(), two[1].clone()].concat()
}

#[test]
fn the_simulator_of_a_trial_begins_as_it_does_for_the_agents_of_the_engine() {
    let Some(python) = needs::python("regimen._trial, gymnasium") else {
        return;
    };
    let program = "import regimen\ntrial = regimen.trial()\nenv, envs = trial.environment(), trial.environment(num_envs=2)\n\
        one = [*env.reset()[0], *env.step([0.5])[0]]\nboth = [envs.reset()[0], envs.step([[0.5], [0.5]])[0]]\n\
        seen = [*both[0][0], *both[1][0], *both[0][1], *both[1][1]]\nassert one == seen[:6], (one, seen)\n\
        for at, value in enumerate(seen):\n    trial.log(step=at, seen=value)\n\
        env.reset(seed=5)\nassert list(env.reset()[0]) != one[:3]\ntrial.measure(lambda rows: 0 * rows[:, 0])\n";
    let more = "      reads: { from: log }\n      metrics: { seen: seen }";
    let Some(bench) = in_python(program, more) else {
        return;
    };
    let text = fs::read_to_string(bench.path("study.yaml")).unwrap();
    let from = text.find("interpreter: ").unwrap();
    let to = from + text[from..].find('\n').unwrap();
    bench.write(
        "study.yaml",
        &format!("{}interpreter: {python}{}", &text[..from], &text[to..]),
    );
    ended_well(&bench);
    bench.ok(&["export", "study.yaml", "--to", "taken", "--as", "csv"]);
    let text = fs::read_to_string(bench.path("taken/training.csv")).unwrap();
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| head.iter().position(|it| *it == name).unwrap();
    let [seed, step, metric, value] = ["seed", "step", "metric", "value"].map(column);
    let rows = lines.map(|row| row.split(',').collect::<Vec<_>>());
    let seen: Vec<Vec<&str>> = rows.filter(|row| row[metric] == "seen").collect();
    for (number, expected) in
        (0..2).flat_map(|seed| observed(seed).into_iter().enumerate().map(move |it| (seed, it)))
    {
        let (at, expected) = expected;
        let is_meant = |row: &&Vec<&str>| row[seed] == number.to_string() && row[step] == at.to_string();
        let row = seen.iter().find(is_meant);
        let found = row.and_then(|row| row[value].parse::<f64>().ok());
        assert_eq!(found, Some(expected), "seed {number}, {at}: {row:?}");
    }
}

#[test]
fn the_last_measurement_is_needed_once() {
    let last = "trial.measure(lambda rows: [0.0] * len(rows))\n";
    let begun = "import regimen_trial\ntrial = regimen_trial.trial()\n";
    for (program, why) in [
        (begun.to_owned(), "ended without its last measurement"),
        (format!("{begun}{last}{last}"), "asked for twice"),
        (
            format!("{begun}trial.measure(lambda rows: [[0.0, 0.0]] * len(rows))\n"),
            "gave 256 of 2",
        ),
        (
            format!("{begun}trial.measure(lambda rows: 1 / 0)\n"),
            "ZeroDivisionError",
        ),
        (
            format!(
                "{begun}import os, signal\ntrial.measure(lambda rows: os.kill(os.getpid(), signal.SIGSEGV))\n"
            ),
            "signal 11",
        ),
        (
            format!("{begun}trial.measure(lambda rows: [[9.0]] * len(rows))\n"),
            "outside its space",
        ),
        (
            format!("{begun}trial.measure(lambda rows: [[float('nan')]] * len(rows))\n"),
            "the action of the program (counted in its decisions) is not finite at step",
        ),
        (
            format!(
                "{begun}try:\n    trial.measure(lambda rows: 1 / 0)\nexcept ZeroDivisionError:\n    {last}"
            ),
            "an error in `act` may not be caught around `trial.measure`",
        ),
    ] {
        let Some(bench) = in_python(&program, "") else {
            return;
        };
        assert_eq!(ended(&bench).code, 100, "{program}");
        assert!(reason(&bench).contains(why), "{program}: {}", reason(&bench));
    }
}

/// A policy that gives zeros, and one that needs what nobody knows.
fn policy(operator: &str) -> Vec<u8> {
    let (mut graph, observation) = Graph::of_observation(3);
    let weight = graph.constant("weight", &[3, 1], &[0.0; 3]);
    let artifact = graph.node("MatMul", &[&observation, &weight], &[]);
    let action = graph.node(operator, &[&artifact], &[]);
    graph.acting(&action, 1).to_bytes(&[])
}

fn leaving(operator: &str) -> Bench {
    let bench = Bench::new();
    fs::write(bench.path("zero.onnx"), policy(operator)).unwrap();
    bench.write(
        "a.sh",
        "mkdir left; cp zero.onnx left/policy.onnx; echo step=100 loss=0.5\n",
    );
    let program = "      run: [sh, a.sh]\n      sources: [a.sh, zero.onnx]\n      measured: policy\n      leaves: { policy: \
                   \"left/*.onnx\" }\n      metrics: { loss: loss }";
    bench.write("study.yaml", &study(program));
    bench
}

#[test]
fn a_policy_that_a_program_leaves_is_measured_and_kept() {
    let bench = leaving("Tanh");
    ended_well(&bench);
    let still = measured(&bench, "zero_action", &[Phase::Final]);
    assert!(of_engine(&bench, &["loss"], &[Phase::Final]) == still && still.len() > 2 * 300);
    bench.ok(&["export", "study.yaml", "--to", "policies", "--as", "onnx"]);
    let listed = fs::read_to_string(bench.path("policies/policies.json")).unwrap();
    let listed: Value = serde_json::from_str(&listed).unwrap();
    let folder = listed["policies"][0]["folder"].as_str().unwrap_or_default();
    let found = bench.path("policies").join(folder).join("policy.onnx");
    assert_eq!(fs::read(found).unwrap(), policy("Tanh"));
    bench.ok(&["fsck", "--store", "store"]);
}

#[test]
fn a_policy_is_taken_elsewhere() {
    let bench = leaving("Tanh");
    let text = fs::read_to_string(bench.path("study.yaml")).unwrap();
    let text = text.replace("agents:\n", "agents:\n  taken: { policy: { from: mine } }\n");
    bench.write("study.yaml", &text);
    ended_well(&bench);
    let still = measured(&bench, "zero_action", &[Phase::Final]);
    assert!(measured(&bench, "", &[Phase::Final]) == still);
}

#[test]
fn operators_that_are_not_known_are_named() {
    let bench = leaving("Det");
    assert_eq!(ended(&bench).code, 100);
    let told = reason(&bench);
    assert!(
        told.contains("needs `Det`, which are not known; known are Abs, Add"),
        "{told}"
    );
}

/// Output of `check` for a study.
fn refused(study: &str) -> String {
    let bench = Bench::new();
    bench.write("a.sh", "");
    bench.write("study.yaml", study);
    let answer = bench.run(&["check", "study.yaml"]);
    assert_ne!(answer.code, 0, "{}", answer.out);
    answer.err
}

#[test]
fn what_cannot_be_measured_is_refused_before_anything_runs() {
    let program = "      run: [sh, a.sh]\n      sources: [a.sh]\n      measured: calls";
    let whole = study(program);
    let several = whole
        .replace("pendulum: {}", "particles: {}")
        .replace("  still: { zero_action: {} }\n", "");
    let told = refused(&several.replace("still.return", "mine.return"));
    assert!(told.contains("is measured where one agent acts"), "{told}");
    let named = several
        .replace("particles: {}", "named: { id: a }")
        .replace("still.return", "mine.return");
    let told = refused(&named);
    assert!(
        told.contains("nothing can be measured in an environment that is only named"),
        "{told}"
    );
    let told = refused(&format!(
        "{whole}overrides:\n  - {{ agent: mine, set: {{ mine.measured: policy }} }}\n"
    ));
    assert!(
        told.contains("no sweep, search or override can change it") || told.contains("write both"),
        "{told}"
    );
    let told = refused(&whole.replace("lock: none", "lock: none\n      metrics: { return: r }"));
    assert!(
        told.contains("`return` is measured of the other agents"),
        "{told}"
    );
}
