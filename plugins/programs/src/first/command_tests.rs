use super::*;
use serde_json::json;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "train.py",
        "config.toml",
        "run",
        "pkg/__init__.py",
        "pkg/__main__.py",
        ".venv/bin/python",
    ] {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "").unwrap();
    }
    folder
}

fn read(text: &str) -> Command {
    let words: Vec<String> = text.split(' ').map(str::to_owned).collect();
    Command::of(&words, folder().path(), &BTreeSet::new(), &Help::default())
}

fn written(command: &Command) -> String {
    let words: Vec<&str> = command.words.iter().map(|it| it.written.as_str()).collect();
    words.join(" ")
}

fn started(command: &Command) -> String {
    let words: Vec<&str> = command.words.iter().map(|it| it.started.as_str()).collect();
    words.join(" ")
}

fn parameters(command: &Command) -> Vec<(&str, Value)> {
    command
        .parameters
        .iter()
        .map(|it| (it.name.as_str(), it.value.clone()))
        .collect()
}

#[test]
fn options_with_values_become_parameters_but_for_seed_steps_task_and_places() {
    let command = read(
        "python -u train.py --lr 3e-4 --seed=1 --total-timesteps 1e4 --epochs 3 --env-id CartPole-v1 --out runs --track \
         --gamma -1 --config config.toml",
    );
    assert_eq!(
        written(&command),
        "python -u train.py --lr {lr} --seed={seed} --total-timesteps {steps} --epochs {epochs} --env-id \
         {environment.id} --out runs --track --gamma {gamma} --config config.toml"
    );
    let values = [("lr", json!(0.0003)), ("epochs", json!(3)), ("gamma", json!(-1))];
    assert_eq!(parameters(&command), values);
    assert_eq!(
        (command.head, command.files),
        (3, vec!["train.py".to_owned(), "config.toml".into()])
    );
    assert_eq!(command.kept, ["--out runs"]);
}

#[test]
fn the_longest_training_is_the_steps() {
    let command = read("python train.py --epochs 3 --max-steps 500");
    assert_eq!(
        written(&command),
        "python train.py --epochs {epochs} --max-steps {steps}"
    );
    assert_eq!(command.steps, Some(("--max-steps".into(), 500)));
    let mut kept = command;
    kept.keep_steps();
    assert_eq!(
        written(&kept),
        "python train.py --epochs {epochs} --max-steps 500"
    );
}

#[test]
fn overrides_are_options() {
    let command = read("python train.py optim.lr=0.1 +seed=3 db=mysql");
    assert_eq!(
        written(&command),
        "python train.py optim.lr={optim_lr} +seed={seed} db={db}"
    );
    assert!(command.has_overrides && command.seed.is_some());
}

#[test]
fn swept_options_are_parameters_except_for_the_seed() {
    let words = ["python", "train.py", "--env=a", "--seed=1", "--out=x"].map(str::to_owned);
    let swept = ["--env", "--seed", "--out"].map(str::to_owned).into();
    let command = Command::of(&words, folder().path(), &swept, &Help::default());
    assert_eq!(
        written(&command),
        "python train.py --env={env} --seed={seed} --out={out}"
    );
}

#[test]
fn the_program_is_a_module_a_file_or_what_is_installed() {
    let module = read("python -m pkg --x 1");
    assert_eq!(
        (module.head, module.files.clone()),
        (3, vec!["pkg/__main__.py".to_owned(), "pkg/__init__.py".into(),])
    );
    let own = read("./run 1 --flag");
    assert_eq!(
        (own.head, own.files, own.interpreter.as_str()),
        (1, vec!["run".to_owned()], "")
    );
    assert_eq!(own.kept, ["1"]);
    let installed = read("learn --x 1 {a}");
    assert_eq!((installed.head, installed.files.len()), (1, 0));
    assert_eq!(written(&installed), "learn --x {x} {{a}}");
    assert_eq!(started(&installed), "learn --x 1 {a}");
    let interpreter = read(".venv/bin/python train.py --seed 1");
    assert_eq!(written(&interpreter), "python train.py --seed {seed}");
    assert_eq!(
        (interpreter.interpreter.as_str(), interpreter.head),
        (".venv/bin/python", 2)
    );
    let own = read("learn --lr 1 --config config.toml");
    assert_eq!(
        (own.head, written(&own).as_str()),
        (1, "learn --lr {lr} --config config.toml")
    );
}

#[test]
fn missing_options_are_taken_from_the_help() {
    let help = Help::read(include_str!("../../fixtures/argparse.txt"));
    let mut command = read("python train.py --lr 0.1");
    let others = command.complete(&help);
    assert_eq!(
        written(&command),
        "python train.py --lr {lr} --seed {seed} --total-timesteps {steps} --env-id {environment.id}"
    );
    assert_eq!(
        started(&command),
        "python train.py --lr 0.1 --seed 1 --total-timesteps 500000 --env-id CartPole-v1"
    );
    let names: Vec<&str> = others.iter().map(HelpOption::name).collect();
    assert_eq!(names, ["--track", "--tag"]);
    let mut given = read("python train.py -e Pendulum-v1 --seed 3");
    assert_eq!(given.complete(&Help::default()).len(), 0);
    given.complete(&help);
    assert_eq!(given.seed.as_deref(), Some("--seed"));
    assert!(
        !written(&given).contains("{environment.id}"),
        "{}",
        written(&given)
    );
    let hydra = Help::read(include_str!("../../fixtures/hydra.txt"));
    let mut command = read("python train.py");
    command.complete(&hydra);
    assert_eq!(written(&command), "python train.py seed={seed}");
}

#[test]
fn a_module_comes_with_the_packages_around_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("a/b")).unwrap();
    for name in ["a/__init__.py", "a/b/__init__.py", "a/b/train.py"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    let words = ["python", "-m", "a.b.train"].map(str::to_owned);
    let command = Command::of(&words, folder.path(), &BTreeSet::new(), &Help::default());
    assert_eq!(
        command.files,
        ["a/b/train.py", "a/b/__init__.py", "a/__init__.py"]
    );
}

#[test]
fn options_are_known_by_the_other_names_that_the_help_lists() {
    let help = Help::read(
        "options:\n  -s SEED, --seed SEED\n  -l LR, --lr LR  rate (default: 0.1)\n  -n N, --steps N  (default: 9)\n",
    );
    let words: Vec<String> = "python train.py -s 3 -l 0.5 -n 200"
        .split(' ')
        .map(str::to_owned)
        .collect();
    let mut command = Command::of(&words, folder().path(), &BTreeSet::new(), &help);
    assert!(command.complete(&help).is_empty());
    assert_eq!(written(&command), "python train.py -s {seed} -l {lr} -n {steps}");
    assert_eq!(parameters(&command), [("lr", json!(0.5))]);
}

#[test]
fn an_option_that_is_repeated_stays_one() {
    let command = read("python train.py --seed 1 --seed 2 --steps 5 --steps 70");
    assert_eq!(
        written(&command),
        "python train.py --seed {seed} --seed {seed} --steps {steps} --steps {steps}"
    );
    assert_eq!(command.steps, Some(("--steps".into(), 70)));
}

#[test]
fn a_value_is_a_number_only_where_it_spells_the_same() {
    let command = read("python train.py --code 007 --release 1.10 --gamma -0.50 --lr 3e-4");
    let values = [
        ("code", json!("007")),
        ("release", json!("1.10")),
        ("gamma", json!(-0.5)),
        ("lr", json!(0.0003)),
    ];
    assert_eq!(parameters(&command)[..], values);
}
