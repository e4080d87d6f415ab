//! What the manifests promise: who may depend on whom.

use crate::program::repository;

fn manifest(folder: &str) -> String {
    std::fs::read_to_string(repository().join(folder).join("Cargo.toml")).unwrap()
}

fn depends_on(folder: &str, name: &str) -> bool {
    manifest(folder).lines().any(|line| line.split(['.', ' ', '=']).next() == Some(name))
}

#[test]
fn the_engine_and_numerics_depend_on_no_workspace_crate() {
    for name in ["engine", "numerics", "environments", "agents"] {
        assert!(!depends_on("plugins/numerics", name), "numerics depends on {name}");
        assert!(!depends_on("engine", name), "engine depends on {name}");
    }
}

#[test]
fn agents_and_environments_do_not_know_each_other() {
    assert!(!depends_on("plugins/agents", "environments"));
    assert!(!depends_on("plugins/environments", "agents"));
}

#[test]
fn one_file_names_polars() {
    let mut naming = Vec::new();
    visit(&repository().join("engine/src"), &mut |path, text| {
        if text.contains("polars::") || text.contains("polars_io::") {
            naming.push(path.file_name().unwrap().to_string_lossy().into_owned());
        }
    });
    assert_eq!(naming, ["parquet.rs"]);
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
