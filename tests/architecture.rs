//! What the manifests promise: who may depend on whom.

use crate::program::repository;

fn manifest(folder: &str) -> String {
    std::fs::read_to_string(repository().join(folder).join("Cargo.toml")).unwrap()
}

fn depends_on(folder: &str, name: &str) -> bool {
    manifest(folder)
        .lines()
        .any(|line| line.split(['.', ' ', '=']).next() == Some(name))
}

#[test]
fn the_engine_and_numerics_depend_on_no_workspace_crate() {
    for name in [
        "engine",
        "numerics",
        "environments",
        "agents",
        "estimators",
        "generators",
        "programs",
        "python",
    ] {
        assert!(
            !depends_on("plugins/numerics", name),
            "numerics depends on {name}"
        );
        assert!(!depends_on("engine", name), "engine depends on {name}");
    }
}

#[test]
fn agents_and_environments_do_not_know_each_other() {
    assert!(!depends_on("plugins/agents", "environments"));
    assert!(!depends_on("plugins/environments", "agents"));
    // Estimators carry a model of the plant, and are nobody's part.
    for folder in ["plugins/agents", "plugins/environments"] {
        assert!(
            !depends_on(folder, "estimators") && !depends_on(folder, "generators"),
            "{folder}"
        );
    }
}

/// So that whoever has no Python can leave it out.
#[test]
fn environments_in_python_and_the_other_plugins_do_not_know_each_other() {
    for folder in ["numerics", "environments", "agents", "estimators", "generators"] {
        assert!(!depends_on(&format!("plugins/{folder}"), "python"), "{folder}");
        assert!(!depends_on("plugins/python", folder), "{folder}");
    }
}

/// So that no simulator and no learner is needed for a trial of a program.
#[test]
fn programs_and_the_other_plugins_do_not_know_each_other() {
    for folder in [
        "numerics",
        "environments",
        "agents",
        "estimators",
        "generators",
        "python",
    ] {
        assert!(!depends_on(&format!("plugins/{folder}"), "programs"), "{folder}");
        assert!(
            folder == "numerics" || !depends_on("plugins/programs", folder),
            "{folder}"
        );
    }
}

/// So that no program needs to know of the Python package, which knows them all.
#[test]
fn nothing_depends_on_the_python_package() {
    for folder in [
        "engine",
        "plugins/environments",
        "plugins/agents",
        "plugins/python",
    ] {
        assert!(!depends_on(folder, "pyo3"), "{folder}");
    }
    assert!(!manifest(".").contains("regimen-wheel"));
}

/// So that simulated systems compile without the tensors that learning needs.
#[test]
fn environments_do_not_depend_on_networks() {
    assert!(!depends_on("plugins/environments", "numerics") && !depends_on("plugins/environments", "burn"));
}

#[test]
fn one_folder_names_the_library_for_parquet() {
    visit(&repository().join("engine/src"), &mut |path, text| {
        let names_it = text.contains("use parquet::") || text.contains("use ::parquet::");
        assert!(
            !names_it || path.parent().unwrap().ends_with("engine/src/parquet"),
            "{path:?}"
        );
    });
}

/// What two agents need lies in `shared`; one agent alone is about another, whose gradients it takes apart.
#[test]
fn no_agent_is_made_of_another() {
    let mut found = Vec::new();
    visit(&repository().join("plugins/agents/src"), &mut |path, text| {
        let foreign =
            |line: &&str| line.starts_with("use crate::") && !line.starts_with("use crate::shared::");
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        found.extend(
            text.lines()
                .filter(foreign)
                .map(|line| (name.clone(), line.to_owned())),
        );
    });
    let about = "use crate::tdom_ac::{self, OpponentObjective};";
    assert_eq!(found, [("opponent_gradients.rs".to_owned(), about.to_owned())]);
}

/// So that tests can put a simulated machine in its place.
#[test]
fn one_module_names_files_clocks_and_processes() {
    let mut found = Vec::new();
    visit(&repository().join("engine/src"), &mut |path, text| {
        let name = path.to_string_lossy().into_owned();
        let is_test = name.ends_with("tests.rs") || name.contains("/tests/");
        if is_test || name.contains("/world/") {
            return;
        }
        let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        let imported = text
            .split("use std::{")
            .nth(1)
            .and_then(|rest| rest.split("};").next());
        let imports = imported.unwrap_or_default().split([',', '{', '}', ' ', '\n']);
        let foreign = ["fs", "fs::File", "process::Command"];
        found.extend(
            imports
                .filter(|it| foreign.contains(it) || it.starts_with("fs::"))
                .map(|it| format!("{name}: {it}")),
        );
        let words = [
            "std::fs",
            "process::Command::",
            "std::process::id",
            "Instant::now()",
            "SystemTime::now()",
            "thread::sleep",
            "RandomState",
            ".elapsed()",
            ".exists()",
            ".canonicalize()",
            ".symlink_metadata()",
            "path.is_file()",
            "path.is_dir()",
            "folder.is_dir()",
        ];
        found.extend(
            words
                .into_iter()
                .filter(|word| text.contains(word))
                .map(|word| format!("{name}: {word}")),
        );
    });
    // The bar that shows progress has a clock of its own.
    found.retain(|it| !it.ends_with("cli/progress.rs: .elapsed()"));
    assert_eq!(found, [""; 0]);
}

fn visit(folder: &std::path::Path, seen: &mut dyn FnMut(&std::path::Path, &str)) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            visit(&path, seen);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            seen(&path, &std::fs::read_to_string(&path).unwrap());
        }
    }
}
