//! What the manifests promise: who may depend on whom.

use crate::program::repository;

/// Every crate by its folder, with the crates of this project that it stands on. Each stands on crates above it alone.
const ARROWS: [(&str, &[&str]); 24] = [
    ("engine/document", &[]),
    ("engine/contract", &["document"]),
    ("engine/statistics", &["contract", "document"]),
    ("engine/execution", &["contract", "document"]),
    ("engine/analysis", &["contract", "document", "statistics"]),
    (
        "engine/imported",
        &["analysis", "contract", "document", "execution", "statistics"],
    ),
    (
        "engine/presentation",
        &["analysis", "contract", "document", "statistics"],
    ),
    (
        "engine/study",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "statistics",
        ],
    ),
    (
        "engine/report",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "statistics",
            "study",
        ],
    ),
    (
        "engine/session",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "report",
            "statistics",
            "study",
        ],
    ),
    (
        "engine/cli",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "report",
            "session",
            "statistics",
            "study",
        ],
    ),
    ("engine", &["cli", "contract", "session"]),
    // Tests alone stand on it.
    ("engine/testing", &["analysis", "contract"]),
    ("plugins/arithmetic", &[]),
    ("plugins/numerics", &[]),
    ("plugins/protocols", &["contract", "document", "statistics"]),
    ("plugins/environments", &["contract", "document", "statistics"]),
    ("plugins/agents", &["contract", "numerics"]),
    ("plugins/estimators", &["contract", "environments", "numerics"]),
    ("plugins/generators", &["contract", "numerics", "statistics"]),
    (
        "plugins/programs",
        &["contract", "document", "execution", "imported", "numerics"],
    ),
    ("plugins/python", &["contract", "document", "execution"]),
    (
        ".",
        &[
            "agents",
            "cli",
            "contract",
            "environments",
            "estimators",
            "execution",
            "generators",
            "numerics",
            "programs",
            "protocols",
            "python",
        ],
    ),
    // Nothing stands on the Python package, which knows them all.
    (
        "plugins/wheel",
        &["contract", "document", "regimen", "session", "study"],
    ),
];

/// The crates of this project among the dependencies of a crate, but for those of its tests.
fn stands_on(folder: &str) -> Vec<String> {
    let manifest = std::fs::read_to_string(repository().join(folder).join("Cargo.toml")).unwrap();
    let section = manifest.split("\n[dependencies]\n").nth(1).unwrap_or_default();
    let section = section.split("\n[").next().unwrap_or_default();
    let name = |line: &str| line.split(['.', ' ', '=']).next().map(str::to_owned);
    let is_ours = |name: &String| {
        let folders = ARROWS.iter().map(|(folder, _)| folder.rsplit('/').next());
        folders.flatten().any(|it| it == name) || name == "regimen"
    };
    let mut found: Vec<String> = section.lines().filter_map(name).filter(is_ours).collect();
    found.sort_unstable();
    found
}

#[test]
fn crates_stand_on_those_that_are_listed() {
    let mut above = vec!["regimen"];
    for (folder, crates) in ARROWS {
        assert_eq!(stands_on(folder), crates, "{folder}/Cargo.toml");
        assert!(crates.iter().all(|name| above.contains(name)), "{folder}");
        above.extend(folder.rsplit('/').next());
    }
}

#[test]
fn the_page_on_the_architecture_has_a_row_for_every_crate() {
    let page = std::fs::read_to_string(repository().join("ARCHITECTURE.md")).unwrap();
    for (folder, _) in ARROWS.iter().filter(|(folder, _)| *folder != ".") {
        assert!(page.contains(&format!("| `{folder}/` |")), "{folder}");
    }
}

#[test]
fn one_folder_names_the_library_for_parquet() {
    visit(&repository().join("engine"), &mut |path, text| {
        let names_it = text.contains("use parquet::") || text.contains("use ::parquet::");
        assert!(
            !names_it || path.parent().unwrap().ends_with("engine/contract/src/parquet"),
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
    for name in ["execution", "imported", "study", "report", "session", "cli"] {
        visit(
            &repository().join("engine").join(name).join("src"),
            &mut |path, text| {
                found.extend(foreign_words(path, text));
            },
        );
    }
    // The bar that shows progress has a clock of its own.
    found.retain(|it| !it.ends_with("commands/progress.rs: .elapsed()"));
    assert_eq!(found, [""; 0]);
}

/// Words of a file of code that touch files, clocks or processes past `execution::world`.
fn foreign_words(path: &std::path::Path, text: &str) -> Vec<String> {
    let name = path.to_string_lossy().into_owned();
    let is_test = name.ends_with("tests.rs") || name.contains("/tests/");
    if is_test || name.contains("/world/") {
        return Vec::new();
    }
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let imported = text
        .split("use std::{")
        .nth(1)
        .and_then(|rest| rest.split("};").next());
    let imports = imported.unwrap_or_default().split([',', '{', '}', ' ', '\n']);
    let foreign = ["fs", "fs::File", "process::Command"];
    let imports = imports.filter(|it| foreign.contains(it) || it.starts_with("fs::"));
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
    let words = words.into_iter().filter(|word| text.contains(word));
    imports.chain(words).map(|it| format!("{name}: {it}")).collect()
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
