//! Policies of stored trials, and what is refused of them.

use super::*;

const STUDY: &str = "
study: taken
title: Policies that are taken away
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 2, final_episodes: \
3 } }
seeds: 2
";

const GAME: &str = "
study: game
title: Policies of several seats
environments: { navigation: { particles: { scenario: cooperative_navigation } } }
agents: { sac: { independent_sac: { width: 8, batch_size: 8, learning_starts: 16 } } }
protocol: { train_evaluate: { steps: 32, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: 1 } }
seeds: 1
";

/// Id, folder and agent of every trial in a store.
fn stored(bench: &Bench) -> Vec<(String, PathBuf, String)> {
    let of = |file: PathBuf| {
        let text: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
        let folder = file.parent().unwrap().to_path_buf();
        let id = folder.file_name().unwrap().to_string_lossy().into_owned();
        (
            id,
            folder,
            text["key"]["agent"]["plugin"]
                .as_str()
                .unwrap_or_default()
                .to_owned(),
        )
    };
    trial_files(&bench.path("store")).into_iter().map(of).collect()
}

#[test]
fn a_policy_of_the_store_is_taken_away_with_what_it_is() {
    let bench = Bench::new();
    bench.write("taken.yaml", STUDY);
    bench.ok(&["run", "taken.yaml"]);
    let trials = stored(&bench);
    let (id, folder, _) = trials
        .iter()
        .find(|(_, _, agent)| agent == "dirichlet_sac")
        .unwrap();
    let out = bench.ok(&["export", "--onnx", id, "-o", "one"]);
    assert!(out.contains("policy.onnx in `one`"), "{out}");
    bench.ok(&["export", "--onnx", &id[..12], "--to", "two"]);
    let bytes = fs::read(bench.path("one/policy.onnx")).unwrap();
    assert_eq!(bytes, fs::read(bench.path("two/policy.onnx")).unwrap());
    // Properties are texts: they stand in the file as they are.
    let text = String::from_utf8_lossy(&bytes);
    let digest = contract::digest::of_bytes(&fs::read(folder.join("policy.safetensors")).unwrap());
    for property in [
        id.as_str(),
        digest.as_str(),
        "dirichlet_sac",
        "battery",
        "dirichlet_mean",
        "[\"V\",\"V\",\"A\",\"A\",\"W\"]",
    ] {
        assert!(text.contains(property), "{property}");
    }
    let policy = Policy::read(folder).unwrap();
    let cases = Cases::new();
    let rows = around(
        &policy.header.center,
        &policy.header.spread,
        &mut stream(&["portable"]),
    );
    cases.add("stored", &bytes, &rows, |row| policy.act(row));
    cases.hold();

    let out = bench.run(&["export", "taken.yaml", "--to", "all", "--as", "onnx"]);
    assert_eq!(out.code, 0, "{}", out.err);
    assert!(out.err.contains("2 trials left no policy"), "{}", out.err);
    let listed: Value = serde_json::from_slice(&fs::read(bench.path("all/policies.json")).unwrap()).unwrap();
    let policies = listed["policies"].as_array().unwrap();
    assert_eq!(policies.len(), 2);
    let own = policies
        .iter()
        .find(|entry| entry["trial"] == id.as_str())
        .unwrap();
    let file = bench
        .path("all")
        .join(own["folder"].as_str().unwrap())
        .join("policy.onnx");
    assert_eq!(fs::read(file).unwrap(), bytes);
}

#[test]
fn every_seat_has_a_file() {
    let bench = Bench::new();
    bench.write("game.yaml", GAME);
    bench.ok(&["run", "game.yaml"]);
    let (id, ..) = stored(&bench).remove(0);
    bench.ok(&["export", "--onnx", &id, "--to", "seats"]);
    let mut names: Vec<String> = fs::read_dir(bench.path("seats"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["agent_0.onnx", "agent_1.onnx", "agent_2.onnx"]);
    bench.ok(&["export", "--minari", &id, "--episodes", "1", "--to", "episodes"]);
    let played = contract::Dataset::read_from(&bench.path("episodes")).unwrap();
    assert_eq!(played.interface.seats.len(), 3);
}

/// Trials of which some cannot be taken away.
struct Stored {
    bench: Bench,
    trials: Vec<(String, PathBuf, String)>,
}

impl Stored {
    fn new() -> Self {
        let bench = Bench::new();
        bench.write("taken.yaml", STUDY);
        bench.ok(&["run", "taken.yaml"]);
        let trials = stored(&bench);
        Self { bench, trials }
    }

    /// Id and folder of a trial of this agent.
    fn by(&self, plugin: &str) -> (&str, &Path) {
        let (id, folder, _) = self.trials.iter().find(|(_, _, agent)| agent == plugin).unwrap();
        (id, folder)
    }

    /// Lets a trial be refused, with these words, and nothing be written.
    fn refused(&self, trial: &str, said: &str) {
        let answer = self.bench.run(&["export", "--onnx", trial, "--to", "taken"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(answer.err.contains(said), "{}", answer.err);
        assert!(!self.bench.path("taken").exists());
    }
}

#[test]
fn what_names_no_trial_with_a_policy_is_refused_and_leaves_nothing() {
    let stored = Stored::new();
    stored.refused("nowhere", "has an id that begins with `nowhere`");
    stored.refused("", "begins the ids of 4 trials");
    let (rule, folder) = stored.by("equal_split");
    stored.refused(rule, "left no policy: `equal_split` learns none");
    let path = folder.join("trial.json");
    let trial = fs::read_to_string(&path).unwrap();
    let failed = trial.replace("\"state\":\"ok\"", "\"state\":\"panicked\"");
    assert_ne!(failed, trial);
    fs::write(&path, reseal(&failed)).unwrap();
    stored.refused(rule, "ended as panicked");
    fs::remove_file(path).unwrap();
    stored.refused(rule, "has not ended");
}

#[test]
fn a_policy_that_is_damaged_or_of_an_unknown_form_is_refused_and_leaves_nothing() {
    let stored = Stored::new();
    let (learner, folder) = stored.by("dirichlet_sac");
    let path = folder.join("policy.safetensors");
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, &bytes).unwrap();
    stored.refused(learner, "`policy.safetensors` is damaged or not there");
    // Acknowledged, but no policy: what a form that nobody registered would leave.
    let trial = fs::read_to_string(folder.join("trial.json")).unwrap();
    let before = serde_json::from_str::<Value>(&trial).unwrap()["files"]["policy.safetensors"].clone();
    let acknowledged = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let digest = contract::digest::of_bytes(bytes);
        let text = reseal(&trial.replace(before.as_str().unwrap(), &digest));
        fs::write(folder.join("trial.json"), text).unwrap();
    };
    acknowledged(b"nonsense");
    stored.refused(learner, "not a file of f32 tensors");
    let mut other = numerics::tensor_file::TensorFile::default();
    other.header = json!({ "kind": "another" });
    other.write(&stored.bench.path("other")).unwrap();
    acknowledged(&fs::read(stored.bench.path("other")).unwrap());
    stored.refused(
        learner,
        "in a form that is known here: dense, equivariant, opponent_models",
    );
}
