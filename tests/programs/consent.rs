//! Programs start when the person agreed to it who runs them: by `--yes`, once, or by a list of folders in a file
//! of that person. A project cannot say it for them.

use super::*;

fn place() -> Place {
    Place::new("echo r=1\n", "{ return: r }", "")
}

fn unasked(place: &Place) -> Answer {
    place.bench.run(&["run", "study.yaml"])
}

#[test]
fn a_program_that_was_never_agreed_to_does_not_start() {
    let place = place();
    let answer = unasked(&place);
    assert_eq!(answer.code, 2, "{}", answer.err);
    assert!(
        answer.err.contains("sh a.sh {seed} {steps} (in "),
        "{}",
        answer.err
    );
    assert!(answer.err.contains("`--yes` starts them"), "{}", answer.err);
    assert!(!place.bench.path("store").exists());
    let check = place.bench.ok(&["check", "study.yaml"]);
    assert!(check.contains("`run` starts `sh a.sh {seed} {steps}`"), "{check}");
}

#[test]
fn who_agreed_once_is_not_asked_again_for_the_same_words() {
    let place = place();
    assert_eq!(place.run(&[]).code, 0);
    let study = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    place
        .bench
        .write("study.yaml", &study.replace("seeds: 1", "seeds: 2"));
    place.bench.write("a.sh", "echo r=2\n");
    let again = unasked(&place);
    assert_eq!(again.code, 0, "edited sources do not ask again: {}", again.err);
    place
        .bench
        .write("study.yaml", &study.replace("[sh, a.sh", "[sh, -e, a.sh"));
    assert_eq!(unasked(&place).code, 2, "other words do");
    place.bench.write(
        "study.yaml",
        &study.replace("lock: none", "lock: none\n      variables: { PATH: /elsewhere }"),
    );
    let answer = unasked(&place);
    assert_eq!(answer.code, 2, "other variables do");
    let listed = "PATH=/elsewhere sh a.sh {seed} {steps}";
    assert!(answer.err.contains(listed), "{}", answer.err);
    let check = place.bench.ok(&["check", "study.yaml"]);
    assert!(check.contains(listed), "{check}");
    use std::os::unix::fs::PermissionsExt as _;
    let mode = fs::metadata(place.bench.path("state/regimen/programs.json"))
        .unwrap()
        .permissions()
        .mode();
    assert_eq!(mode & 0o077, 0, "{mode:o}");
}

#[test]
fn what_is_there_needs_no_program() {
    let place = place();
    assert_eq!(place.run(&[]).code, 0);
    fs::remove_dir_all(place.bench.path("state")).unwrap();
    assert_eq!(unasked(&place).code, 0);
    assert_eq!(place.bench.run(&["verify", "study.yaml"]).code, 2);
}

#[test]
fn a_persons_own_file_says_which_folders_are_trusted_and_a_project_does_not() {
    let place = place();
    let here = place.bench.path("").display().to_string();
    place
        .bench
        .write("regimen.toml", &format!("trusted = [\"{here}\"]\n"));
    let answer = unasked(&place);
    assert_eq!(answer.code, 2);
    assert!(
        answer
            .err
            .contains("a project cannot say that its own programs are trusted"),
        "{}",
        answer.err
    );
    fs::remove_file(place.bench.path("regimen.toml")).unwrap();
    let own = place.bench.path("config/regimen");
    fs::create_dir_all(&own).unwrap();
    fs::write(own.join("regimen.toml"), "trusted = [\"somewhere\"]\n").unwrap();
    assert!(unasked(&place).err.contains("no absolute path"));
    fs::write(own.join("regimen.toml"), format!("trusted = [\"{here}\"]\n")).unwrap();
    assert_eq!(unasked(&place).code, 0);
}
